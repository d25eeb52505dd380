//! Which files scenes refer to, without reading the scenes again.
//!
//! The shape of the graph depends on what a glTF refers to, and that stands in the middle of files that may be large. What
//! was found is kept in one file with the scene's stamp, under the rule of all stamps: it is trusted if it was old enough
//! when the scene was read (see [`crate::disk::Clock`]).
//!
//! Unaware of: recipes, what is done with the files.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::disk::{Clock, Disk, Stamp};
use crate::io::scene::external_files;

/// Largest scene file that is read, in bytes.
const SCENE_LIMIT: u64 = 1 << 31;
/// Largest file of what was found, in bytes.
const SUMMARY_LIMIT: u64 = 1 << 30;
/// Raised when a scene's files are found in another way.
const VERSION: u32 = 1;

/// What is known of scenes.
pub struct Scenes<'a> {
    disk: &'a dyn Disk,
    clock: Clock<'a>,
    /// What was asked for: the file's stamp, unless it cannot be trusted, and the files.
    asked: BTreeMap<PathBuf, (Option<Stamp>, Vec<String>)>,
    saved: BTreeMap<String, Summary>,
    /// Something was asked for that was not saved.
    news: bool,
}

/// What is kept of a scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Summary {
    len: u64,
    mtime_ns: i128,
    inode: u64,
    files: Vec<String>,
}

#[derive(Serialize, Deserialize)]
struct Summaries {
    version: u32,
    scenes: BTreeMap<String, Summary>,
}

impl<'a> Scenes<'a> {
    /// What `file` holds, if it is there and sound.
    pub fn open(disk: &'a dyn Disk, file: &Path, clock: Clock<'a>) -> Self {
        let bytes = disk.read(file, SUMMARY_LIMIT).unwrap_or_default();
        let saved = serde_json::from_slice::<Summaries>(&bytes).ok().filter(|saved| saved.version == VERSION);
        let saved = saved.map(|saved| saved.scenes).unwrap_or_default();
        Scenes { disk, clock, asked: BTreeMap::new(), saved, news: false }
    }

    /// With answers for these scenes, and none but by reading for others.
    pub fn known(
        disk: &'a dyn Disk,
        clock: Clock<'a>,
        scenes: impl IntoIterator<Item = (PathBuf, Vec<String>)>,
    ) -> Self {
        let asked = scenes.into_iter().map(|(path, files)| (path, (None, files))).collect();
        Scenes { disk, clock, asked, saved: BTreeMap::new(), news: false }
    }

    /// What was asked for, and the answers.
    pub fn asked(&self) -> BTreeMap<PathBuf, Vec<String>> {
        self.asked.iter().map(|(path, (_, files))| (path.clone(), files.clone())).collect()
    }

    /// The files that the scene at `path` refers to, relative to it.
    pub fn files(&mut self, path: &Path) -> Result<Vec<String>, String> {
        if let Some((_, files)) = self.asked.get(path) {
            return Ok(files.clone());
        }
        // Before reading: what is written meanwhile has another stamp.
        let stamp = self.disk.stamp(path).map_err(|e| e.to_string())?.ok_or("there is no such file")?;
        let known = path.to_str().and_then(|name| self.saved.get(name));
        let same = known.filter(|s| stamp == Stamp { len: s.len, mtime_ns: s.mtime_ns, inode: s.inode });
        let (stamp, files) = match same {
            Some(summary) => (Some(stamp), summary.files.clone()),
            None => {
                self.news = true;
                let trusted = self.clock.trusts(&stamp).then_some(stamp);
                let bytes = self.disk.read(path, SCENE_LIMIT).map_err(|e| e.to_string())?;
                let label = path.to_string_lossy();
                (trusted, external_files(super::file_name(&label), &bytes).map_err(|e| e.to_string())?)
            }
        };
        self.asked.insert(path.to_path_buf(), (stamp, files.clone()));
        Ok(files)
    }

    /// Keeps what was asked for, if there is something new among it, and forgets other scenes if `all` were asked for.
    pub fn save(&self, file: &Path, all: bool) -> io::Result<()> {
        if !self.news {
            return Ok(());
        }
        let mut scenes = if all { BTreeMap::new() } else { self.saved.clone() };
        for (path, (stamp, files)) in &self.asked {
            if let (Some(path), Some(Stamp { len, mtime_ns, inode })) = (path.to_str(), *stamp) {
                scenes.insert(path.to_string(), Summary { len, mtime_ns, inode, files: files.clone() });
            }
        }
        let bytes = serde_json::to_vec(&Summaries { version: VERSION, scenes })?;
        self.disk.write(file, &bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disk::{Memory, Op};

    const SCENE: &str = r#"{"asset": {"version": "2.0"}, "buffers": [{"uri": "a.bin", "byteLength": 4}]}"#;

    #[test]
    fn a_scene_is_read_once_until_its_stamp_moves() {
        let disk = Memory::new();
        let (scene, saved, probe) = (Path::new("/m.gltf"), Path::new("/scenes"), Path::new("/clock"));
        let reads = |all| {
            disk.take_log();
            let mut scenes = Scenes::open(&disk, saved, Clock::new(&disk, probe));
            let found = [scenes.files(scene).unwrap(), scenes.files(scene).unwrap()];
            scenes.save(saved, all).unwrap();
            assert_eq!(found[0], found[1]);
            let count = disk.take_log().iter().filter(|call| **call == (Op::Read, scene.to_path_buf())).count();
            (count, found[0].clone())
        };
        disk.write(scene, SCENE.as_bytes()).unwrap();
        assert_eq!(reads(true), (1, vec!["a.bin".to_string()]));
        assert_eq!(reads(true).0, 1, "written just now: another edit could bear the same time");
        disk.pass(std::time::Duration::from_secs(3));
        assert_eq!([reads(true).0, reads(true).0], [1, 0]);
        disk.write(scene, SCENE.replace("a.bin", "bc.bin").as_bytes()).unwrap();
        assert_eq!(reads(false), (1, vec!["bc.bin".to_string()]));
        disk.write(saved, b"damaged").unwrap();
        assert_eq!(reads(true).0, 1);
    }
}
