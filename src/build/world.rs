//! A disk in memory and toy steps, for the engine's tests.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicI64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use super::*;
use crate::disk::{Disk, Lock, Stamp};

/// Called with the path before each read.
type Hook = Box<dyn Fn(&MemoryDisk, &Path) + Send + Sync>;

/// Files in memory under a clock that only [`MemoryDisk::tick`] turns.
#[derive(Default)]
pub struct MemoryDisk {
    files: Mutex<BTreeMap<PathBuf, (Vec<u8>, Stamp)>>,
    now_ms: AtomicI64,
    inodes: AtomicUsize,
    pub reads: Mutex<Vec<PathBuf>>,
    pub writes: Mutex<Vec<PathBuf>>,
    pub full: Mutex<Option<PathBuf>>,
    pub before_read: Mutex<Option<Arc<Hook>>>,
}

impl MemoryDisk {
    pub fn new(files: &[(&str, &str)]) -> Self {
        let disk = MemoryDisk::default();
        disk.now_ms.store(1_000_000_001, Ordering::Relaxed);
        files.iter().for_each(|(path, text)| disk.put(path, text));
        disk
    }

    /// Time goes on, beyond any file system's coarseness.
    pub fn tick(&self) {
        self.now_ms.fetch_add(10_000, Ordering::Relaxed);
    }

    pub fn put(&self, path: &str, text: &str) {
        self.insert(Path::new(path), text.as_bytes());
    }

    pub fn text(&self, path: &str) -> Option<String> {
        let files = self.files.lock().unwrap();
        files.get(Path::new(path)).map(|(bytes, _)| String::from_utf8_lossy(bytes).into_owned())
    }

    /// Changes content and leaves the stamp as it is, if the length is the same.
    pub fn put_unnoticed(&self, path: &Path, bytes: &[u8]) {
        let mut files = self.files.lock().unwrap();
        let file = files.get_mut(path).unwrap();
        file.0 = bytes.to_vec();
        file.1.len = bytes.len() as u64;
    }

    pub fn paths(&self, folder: &str) -> Vec<PathBuf> {
        self.list(Path::new(folder)).unwrap()
    }

    pub fn forget_calls(&self) {
        self.reads.lock().unwrap().clear();
        self.writes.lock().unwrap().clear();
    }

    fn insert(&self, path: &Path, bytes: &[u8]) {
        let mtime_ns = i128::from(self.now_ms.fetch_add(1, Ordering::Relaxed)) * 1_000_000 + 1;
        let inode = self.inodes.fetch_add(1, Ordering::Relaxed) as u64;
        let stamp = Stamp { len: bytes.len() as u64, mtime_ns, inode };
        self.files.lock().unwrap().insert(path.to_path_buf(), (bytes.to_vec(), stamp));
    }
}

impl Disk for MemoryDisk {
    fn touch(&self, path: &Path) -> io::Result<()> {
        let mut files = self.files.lock().unwrap();
        let (_, stamp) = files.get_mut(path).ok_or(io::ErrorKind::NotFound)?;
        stamp.mtime_ns = i128::from(self.now_ms.fetch_add(1, Ordering::Relaxed)) * 1_000_000 + 1;
        Ok(())
    }

    fn read(&self, path: &Path, limit: u64) -> io::Result<Vec<u8>> {
        let hook = self.before_read.lock().unwrap().clone();
        if let Some(hook) = hook {
            hook(self, path);
        }
        self.reads.lock().unwrap().push(path.to_path_buf());
        let files = self.files.lock().unwrap();
        let (bytes, _) = files.get(path).ok_or(io::ErrorKind::NotFound)?;
        if bytes.len() as u64 > limit {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        Ok(bytes.clone())
    }

    fn stamp(&self, path: &Path) -> io::Result<Option<Stamp>> {
        Ok(self.files.lock().unwrap().get(path).map(|(_, stamp)| *stamp))
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        if self.full.lock().unwrap().as_ref().is_some_and(|folder| path.starts_with(folder)) {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.writes.lock().unwrap().push(path.to_path_buf());
        self.insert(path, bytes);
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.files.lock().unwrap().remove(path);
        Ok(())
    }

    fn remove_empty(&self, _: &Path) -> io::Result<bool> {
        Ok(false) // Folders are there while files are in them.
    }

    fn list(&self, folder: &Path) -> io::Result<Vec<PathBuf>> {
        Ok(self.files.lock().unwrap().keys().filter(|path| path.starts_with(folder)).cloned().collect())
    }

    fn try_lock(&self, _: &Path) -> io::Result<Option<Box<dyn Lock>>> {
        Err(io::ErrorKind::Unsupported.into())
    }
}

type Work = dyn Fn(&Inputs) -> Result<Vec<u8>, StepError> + Send + Sync;

/// A step made of a name, a kind, parameters and a function.
pub struct Toy {
    pub name: String,
    pub kind: &'static str,
    pub revision: u32,
    pub params: Vec<(&'static str, String)>,
    pub work: Box<Work>,
}

impl Toy {
    pub fn new(name: &str, kind: &'static str, work: impl Fn(&Inputs) -> String + Send + Sync + 'static) -> Self {
        let work = Box::new(move |inputs: &Inputs| Ok(work(inputs).into_bytes()));
        Toy { name: name.to_string(), kind, revision: 1, params: Vec::new(), work }
    }

    /// All inputs one after the other, between them `separator`.
    pub fn concat(name: &str, separator: &str) -> Self {
        let between = separator.to_string();
        let mut toy = Toy::new(name, "concat", move |inputs| texts(inputs).join(&between));
        toy.params.push(("separator", separator.to_string()));
        toy
    }

    /// Its input in capitals.
    pub fn upper(name: &str) -> Self {
        Toy::new(name, "upper", |inputs| texts(inputs).concat().to_uppercase())
    }

    /// The length of its input, as a number: different contents of one length give the same artefact.
    pub fn count(name: &str) -> Self {
        Toy::new(name, "count", |inputs| texts(inputs).concat().len().to_string())
    }

    pub fn fails(name: &str) -> Self {
        let work = Box::new(|_: &Inputs| Err("the moss is too wet".into()));
        Toy { name: name.to_string(), kind: "fails", revision: 1, params: Vec::new(), work }
    }
}

fn texts(inputs: &Inputs) -> Vec<String> {
    (0..inputs.len()).map(|index| String::from_utf8_lossy(&inputs[index]).into_owned()).collect()
}

impl Step for Toy {
    fn name(&self) -> String {
        self.name.clone()
    }
    fn kind(&self) -> &'static str {
        self.kind
    }
    fn revision(&self) -> u32 {
        self.revision
    }
    fn describe(&self, visitor: &mut dyn Visitor) {
        self.params.iter().for_each(|(name, value)| visitor.param(name, value));
    }
    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        (self.work)(inputs)
    }
}

pub fn options(jobs: usize) -> Options {
    Options { jobs, ..Options::default() }
}

/// Some time later, brings everything up to date with two threads.
pub fn later(graph: &Graph, disk: &MemoryDisk) -> Report {
    disk.tick();
    disk.forget_calls();
    run(graph, &[], &options(2), disk, &Silent).unwrap()
}

/// Names of the steps that ran, sorted.
pub fn ran(report: &Report) -> Vec<&str> {
    let mut names: Vec<&str> = report.ran().collect();
    names.sort_unstable();
    names
}
