//! What the last run knew, in one file, so that the next one need not look at contents.
//!
//! For every input file its stamp and digest; for every step its key, artefact and what the key was made of, for
//! explanations; for every output its stamp and digest. One framed file, read at once and parsed in place; a damaged
//! one counts as none, which costs time, never correctness.
//!
//! A file has no stamp here if its stamp cannot be trusted (see `survey`): it is hashed next time.
//!
//! Unaware of: the disk, the cache, what changed.

use std::sync::OnceLock;

use super::codec::{Reader, Writer, open_frame};
use super::digest::Digest;
use super::graph::{Graph, Source, StepId};
use crate::disk::Stamp;

const MAGIC: &[u8; 8] = b"KILNMAN2";

/// Content of a file and the stamp that it had then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FileRecord {
    pub stamp: Option<Stamp>,
    pub digest: Digest,
}

/// A step that was up to date.
#[derive(Clone, Copy, Debug)]
pub(super) struct StepRecord<'a> {
    pub key: Digest,
    pub artefact: Digest,
    pub len: u64,
    /// How long the step took.
    pub wall_ms: u64,
    /// What the key was made of: an encoded [`Detail`].
    detail: &'a [u8],
}

/// What a key was made of.
#[derive(Debug)]
pub(super) struct Detail<'a> {
    pub kind: &'a str,
    pub revision: u32,
    pub params: Vec<(&'a str, &'a str)>,
    /// Label and digest of each input.
    pub inputs: Vec<(&'a [u8], Digest)>,
}

/// Rows found by name: at the place where they were last time, or else by search.
pub(super) struct Table<'a, T> {
    rows: Vec<(&'a [u8], T)>,
    sorted: OnceLock<Vec<u32>>,
}

impl<T> Default for Table<'_, T> {
    fn default() -> Self {
        Table { rows: Vec::new(), sorted: OnceLock::new() }
    }
}

impl<'a, T> Table<'a, T> {
    fn read(reader: &mut Reader<'a>, row: impl Fn(&mut Reader<'a>) -> Option<T>) -> Option<Self> {
        let mut table = Table::default();
        for _ in 0..reader.u32()? {
            table.rows.push((reader.bytes()?, row(reader)?));
        }
        Some(table)
    }

    /// The row called `name`, tried first at index `hint`.
    pub fn get(&self, hint: usize, name: &[u8]) -> Option<&T> {
        if let Some((_, row)) = self.rows.get(hint).filter(|row| row.0 == name) {
            return Some(row);
        }
        let sorted = self.sorted.get_or_init(|| {
            let mut order: Vec<u32> = (0..self.rows.len() as u32).collect();
            order.sort_by_key(|&index| self.rows[index as usize].0);
            order
        });
        let at = sorted.binary_search_by_key(&name, |&index| self.rows[index as usize].0).ok()?;
        Some(&self.rows[sorted[at] as usize].1)
    }

    /// The rows.
    pub fn rows(&self) -> impl Iterator<Item = &T> {
        self.rows.iter().map(|row| &row.1)
    }

    /// The rows, with their names, of things that are none of the `count` that `name` tells.
    pub fn others<'s, 'n>(
        &'s self,
        count: usize,
        name: &dyn Fn(usize) -> &'n [u8],
    ) -> impl Iterator<Item = (&'a [u8], &'s T)> {
        // Mostly they are the same, in the same order.
        let same = count == self.rows.len() && (0..count).all(|index| self.rows[index].0 == name(index));
        let mut ours: Vec<&[u8]> = if same { Vec::new() } else { (0..count).map(name).collect() };
        ours.sort_unstable();
        let rows = if same { &[][..] } else { &self.rows[..] };
        rows.iter().filter(move |row| ours.binary_search(&row.0).is_err()).map(|row| (row.0, &row.1))
    }
}

/// A parsed manifest, borrowing from the file's bytes.
#[derive(Default)]
pub(super) struct Manifest<'a> {
    pub files: Table<'a, FileRecord>,
    pub steps: Table<'a, StepRecord<'a>>,
    pub outputs: Table<'a, FileRecord>,
}

impl<'a> Manifest<'a> {
    /// Parses a manifest; `None` if it is damaged or of another version.
    pub fn parse(frame: &'a [u8]) -> Option<Self> {
        let mut reader = open_frame(MAGIC, frame)?;
        let file = |reader: &mut Reader<'a>| Some(FileRecord { stamp: reader.stamp()?, digest: reader.digest()? });
        let step = |reader: &mut Reader<'a>| {
            let (key, artefact) = (reader.digest()?, reader.digest()?);
            let (len, wall_ms) = (reader.u64()?, reader.u64()?);
            Some(StepRecord { key, artefact, len, wall_ms, detail: reader.bytes()? })
        };
        let files = Table::read(&mut reader, file)?;
        let steps = Table::read(&mut reader, step)?;
        let outputs = Table::read(&mut reader, file)?;
        reader.0.is_empty().then_some(Manifest { files, steps, outputs })
    }

    /// The record of a step of `graph`, by its name.
    pub fn step(&self, graph: &Graph, step: StepId) -> Option<&StepRecord<'a>> {
        self.steps.get(step.index(), graph.name(step).as_bytes())
    }

    /// The record of input file `file` of `graph`, by its path.
    pub fn file(&self, graph: &Graph, file: usize) -> Option<&FileRecord> {
        self.files.get(file, graph.files[file].as_os_str().as_encoded_bytes())
    }

    /// The record of output `output` of `graph`, by its path.
    pub fn output(&self, graph: &Graph, output: usize) -> Option<&FileRecord> {
        self.outputs.get(output, graph.outputs[output].path.as_os_str().as_encoded_bytes())
    }
}

impl<'a> StepRecord<'a> {
    /// The step's kind; `None` only if the manifest was made up.
    pub fn kind(&self) -> Option<&'a str> {
        Reader(self.detail).text()
    }

    /// What the key was made of; `None` only if the manifest was made up.
    pub fn detail(&self) -> Option<Detail<'a>> {
        let mut reader = Reader(self.detail);
        let (kind, revision) = (reader.text()?, reader.u32()?);
        let mut detail = Detail { kind, revision, params: Vec::new(), inputs: Vec::new() };
        for _ in 0..reader.u32()? {
            detail.params.push((reader.text()?, reader.text()?));
        }
        for _ in 0..reader.u32()? {
            detail.inputs.push((reader.bytes()?, reader.digest()?));
        }
        Some(detail)
    }
}

/// What to remember of a step that is up to date now.
pub(super) struct NewStep {
    pub key: Digest,
    pub artefact: Digest,
    pub len: u64,
    pub wall_ms: u64,
    pub inputs: Vec<Digest>,
}

/// What to write about one thing of the graph.
pub(super) enum Entry<T> {
    /// The new record.
    New(T),
    /// What the old manifest said, if anything.
    Old,
    /// Nothing.
    Drop,
}

/// What to write: one entry for every file, step and output of the graph.
pub(super) struct Update {
    pub files: Vec<Entry<FileRecord>>,
    pub steps: Vec<Entry<NewStep>>,
    pub outputs: Vec<Entry<FileRecord>>,
    /// Keep the records of files and steps that are not in the graph.
    pub keep_others: bool,
    /// Keep the records of outputs that are not in the graph, but for these.
    pub forget_outputs: Vec<Vec<u8>>,
}

/// Encodes the manifest: things of the graph in its order, so that they are found by index, then the others.
pub(super) fn encode(graph: &Graph, old: &Manifest, update: &Update) -> Vec<u8> {
    let mut writer = Writer::new(MAGIC);
    let path = |index: usize| graph.files[index].as_os_str().as_encoded_bytes();
    table(
        &mut writer,
        &old.files,
        &update.files,
        &|_| update.keep_others,
        &path,
        &|writer, _, row| file_row(writer, row),
        &file_row,
    );
    let name = |index: usize| graph.nodes[index].name.as_bytes();
    let new_step = |writer: &mut Writer, index: usize, row: &NewStep| {
        step_row(writer, (&row.key, &row.artefact), (row.len, row.wall_ms), &detail(graph, index, &row.inputs));
    };
    let old_step = |writer: &mut Writer, row: &StepRecord| {
        step_row(writer, (&row.key, &row.artefact), (row.len, row.wall_ms), row.detail);
    };
    table(&mut writer, &old.steps, &update.steps, &|_| update.keep_others, &name, &new_step, &old_step);
    let path = |index: usize| graph.outputs[index].path.as_os_str().as_encoded_bytes();
    table(
        &mut writer,
        &old.outputs,
        &update.outputs,
        &|name| update.forget_outputs.iter().all(|gone| gone != name),
        &path,
        &|writer, _, row| file_row(writer, row),
        &file_row,
    );
    writer.finish()
}

fn table<'g, New, Old>(
    writer: &mut Writer,
    old: &Table<'_, Old>,
    entries: &[Entry<New>],
    keep: &dyn Fn(&[u8]) -> bool,
    name: &dyn Fn(usize) -> &'g [u8],
    new_row: &dyn Fn(&mut Writer, usize, &New),
    old_row: &dyn Fn(&mut Writer, &Old),
) {
    let mut rows = Writer::part();
    let mut count = 0u32;
    for (index, entry) in entries.iter().enumerate() {
        let old = old.get(index, name(index));
        if matches!(entry, Entry::Drop) || (matches!(entry, Entry::Old) && old.is_none()) {
            continue;
        }
        count += 1;
        rows.bytes(name(index));
        match (entry, old) {
            (Entry::New(row), _) => new_row(&mut rows, index, row),
            (_, Some(row)) => old_row(&mut rows, row),
            _ => {}
        }
    }
    for (name, row) in old.others(entries.len(), name).filter(|row| keep(row.0)) {
        count += 1;
        rows.bytes(name);
        old_row(&mut rows, row);
    }
    writer.u32(count);
    writer.raw(&rows.into_part());
}

fn file_row(writer: &mut Writer, row: &FileRecord) {
    writer.stamp(row.stamp);
    writer.digest(&row.digest);
}

fn step_row(writer: &mut Writer, (key, artefact): (&Digest, &Digest), (len, wall_ms): (u64, u64), detail: &[u8]) {
    writer.digest(key);
    writer.digest(artefact);
    writer.u64(len);
    writer.u64(wall_ms);
    writer.bytes(detail);
}

fn detail(graph: &Graph, index: usize, inputs: &[Digest]) -> Vec<u8> {
    let node = &graph.nodes[index];
    let mut writer = Writer::part();
    writer.bytes(node.step.kind().as_bytes());
    writer.u32(node.step.revision());
    writer.u32(node.params.len() as u32);
    for (name, value) in &node.params {
        writer.bytes(name.as_bytes());
        writer.bytes(value.as_bytes());
    }
    writer.u32(node.inputs.len() as u32);
    for (source, digest) in node.inputs.iter().zip(inputs) {
        writer.bytes(&tagged_label(graph, *source));
        writer.digest(digest);
    }
    writer.into_part()
}

/// Label of an input that tells files (`f`) from steps (`s`).
pub(super) fn tagged_label(graph: &Graph, source: Source) -> Vec<u8> {
    match source {
        Source::File(file) => [b"f", graph.files[file].as_os_str().as_encoded_bytes()].concat(),
        Source::Step(step) => [b"s", graph.name(step).as_bytes()].concat(),
    }
}
