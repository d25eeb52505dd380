//! Everything that a run with nothing to do looked at, so that the next one need not even plan.
//!
//! A seal says: for this program, asked for this, there was nothing to do while these files had these stamps. If they
//! still have them, there is nothing to do now, and recipes need not be read nor a graph be made. One framed file; without
//! it, or with one that is damaged, the long way gives the same answer.
//!
//! Unaware of: what the files are.

use std::path::{Path, PathBuf};

use super::codec::{Reader, Writer, open_frame};
use super::digest::Digest;
use super::graph::Graph;
use super::options::Options;
use super::run::with_manifest;
use crate::disk::{Disk, Stamp};
use crate::numerics::par;

const MAGIC: &[u8; 8] = b"KILNSEA1";
/// A seal of this size would be that of tens of millions of files.
const SEAL_LIMIT: u64 = 4 << 30;

/// A file and its stamp; `None`: there is no such file.
pub type Look = (PathBuf, Option<Stamp>);

/// What was asked, of which program: a seal of something else does not hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Question(Digest);

/// The answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sealed {
    /// How many steps are up to date.
    pub steps: u64,
    /// How many outputs there are.
    pub outputs: u64,
}

impl Question {
    /// From all that the answer depends on but the sealed files.
    pub fn new(parts: &[&[u8]]) -> Self {
        let mut fields = super::digest::Fields::new("kiln seal");
        parts.iter().for_each(|part| fields.add(part));
        Question(fields.finish())
    }
}

/// The answer of the seal in `file`, if it still holds. Looks at the stamps of all its files.
pub fn check(disk: &dyn Disk, file: &Path, question: &Question) -> Option<Sealed> {
    let frame = disk.read(file, SEAL_LIMIT).ok()?;
    let mut reader = open_frame(MAGIC, &frame)?;
    if reader.digest()? != question.0 {
        return None;
    }
    let sealed = Sealed { steps: reader.u64()?, outputs: reader.u64()? };
    let mut looks = Vec::new();
    while !reader.0.is_empty() {
        looks.push((path(&mut reader)?, reader.stamp()?));
    }
    let holds = |index: usize| {
        let (path, stamp): (&Path, Option<Stamp>) = looks[index];
        disk.stamp(path).is_ok_and(|now| now == stamp)
    };
    par::map(looks.len(), holds).into_iter().all(|holds| holds).then_some(sealed)
}

fn path<'a>(reader: &mut Reader<'a>) -> Option<&'a Path> {
    reader.text().map(Path::new)
}

/// Seals the graph, of which a run has just said that nothing is left to do, and `others`, whose stamps can be trusted.
/// If the stamp of some file can't be trusted yet, an old seal is removed instead: the next run tries again.
pub fn seal(
    graph: &Graph,
    options: &Options,
    disk: &dyn Disk,
    file: &Path,
    question: &Question,
    others: &[Look],
) -> std::io::Result<()> {
    let looks = with_manifest(options, disk, |manifest| {
        let files = (0..graph.files.len()).map(|index| (&graph.files[index], manifest.file(graph, index)));
        let outputs = (0..graph.outputs.len()).map(|index| (&graph.outputs[index].path, manifest.output(graph, index)));
        let look = |(path, record): (&PathBuf, Option<&super::manifest::FileRecord>)| {
            Some((path.clone(), Some(record?.stamp?)))
        };
        files.chain(outputs).map(look).collect::<Option<Vec<Look>>>()
    });
    let mut writer = Writer::new(MAGIC);
    writer.digest(&question.0);
    writer.u64(graph.nodes.len() as u64);
    writer.u64(graph.outputs.len() as u64);
    for (path, stamp) in looks.iter().flatten().chain(others) {
        let Some(path) = path.to_str() else { return disk.remove(file) };
        writer.bytes(path.as_bytes());
        writer.stamp(*stamp);
    }
    if looks.is_none() { disk.remove(file) } else { disk.write(file, &writer.finish()) }
}
