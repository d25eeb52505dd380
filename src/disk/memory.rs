//! A file system in memory: for tests of whatever talks to a [`Disk`].
//!
//! Time is a counter that moves with each write, so tests neither sleep nor depend on a clock. Every call is noted, and
//! faults can be laid in wait for a call.

use super::{Disk, Lock, Stamp};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The calls of [`Disk`], as noted and as faults are laid for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Op {
    /// [`Disk::read`].
    Read,
    /// [`Disk::stamp`].
    Stamp,
    /// [`Disk::write`] and [`Disk::write_synced`].
    Write,
    /// [`Disk::remove`].
    Remove,
    /// [`Disk::list`].
    List,
    /// [`Disk::try_lock`].
    Lock,
}

#[derive(Debug)]
struct File {
    bytes: Vec<u8>,
    mtime_ns: i128,
    inode: u64,
}

#[derive(Debug, Default)]
struct State {
    files: BTreeMap<PathBuf, File>,
    locked: BTreeSet<PathBuf>,
    faults: BTreeMap<(Op, PathBuf), ErrorKind>,
    log: Vec<(Op, PathBuf)>,
    now: u64,
}

/// A file system in memory. Folders exist while files are in them; clones show the same files.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    state: Arc<Mutex<State>>,
}

impl Memory {
    /// An empty disk.
    pub fn new() -> Self {
        Self::default()
    }

    /// Lets every further `op` on `path` fail with `kind`, until [`Memory::mend`].
    pub fn break_at(&self, op: Op, path: impl Into<PathBuf>, kind: ErrorKind) {
        self.state().faults.insert((op, path.into()), kind);
    }

    /// Lets time pass.
    pub fn pass(&self, time: std::time::Duration) {
        self.state().now += time.as_millis() as u64;
    }

    /// Removes all faults.
    pub fn mend(&self) {
        self.state().faults.clear();
    }

    /// The calls since the last time, in order.
    pub fn take_log(&self) -> Vec<(Op, PathBuf)> {
        std::mem::take(&mut self.state().log)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A test that panicked elsewhere does not spoil the files.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn begin(&self, op: Op, path: &Path) -> io::Result<MutexGuard<'_, State>> {
        let mut state = self.state();
        state.log.push((op, path.to_path_buf()));
        match state.faults.get(&(op, path.to_path_buf())) {
            Some(kind) => Err((*kind).into()),
            None => Ok(state),
        }
    }
}

impl State {
    fn put(&mut self, path: &Path, bytes: Vec<u8>) {
        self.now += 1;
        let file = File { bytes, mtime_ns: i128::from(self.now) * 1_000_000, inode: self.now };
        self.files.insert(path.to_path_buf(), file);
    }

    fn is_folder(&self, path: &Path) -> bool {
        self.files.keys().any(|p| p != path && p.starts_with(path))
    }

    fn check_place(&self, path: &Path) -> io::Result<()> {
        if self.is_folder(path) {
            return Err(ErrorKind::IsADirectory.into());
        }
        match path.ancestors().skip(1).any(|p| self.files.contains_key(p)) {
            true => Err(ErrorKind::NotADirectory.into()),
            false => Ok(()),
        }
    }
}

impl Disk for Memory {
    fn touch(&self, path: &Path) -> io::Result<()> {
        let mut state = self.begin(Op::Write, path)?;
        let bytes = state.files.get(path).ok_or(ErrorKind::NotFound)?.bytes.clone();
        state.put(path, bytes);
        Ok(())
    }

    fn read(&self, path: &Path, limit: u64) -> io::Result<Vec<u8>> {
        let state = self.begin(Op::Read, path)?;
        match state.files.get(path) {
            Some(file) if file.bytes.len() as u64 > limit => Err(ErrorKind::FileTooLarge.into()),
            Some(file) => Ok(file.bytes.clone()),
            None if state.is_folder(path) => Err(ErrorKind::IsADirectory.into()),
            None => Err(ErrorKind::NotFound.into()),
        }
    }

    fn stamp(&self, path: &Path) -> io::Result<Option<Stamp>> {
        let state = self.begin(Op::Stamp, path)?;
        match state.files.get(path) {
            Some(f) => Ok(Some(Stamp { len: f.bytes.len() as u64, mtime_ns: f.mtime_ns, inode: f.inode })),
            None if state.is_folder(path) => Err(ErrorKind::IsADirectory.into()),
            None => Ok(None),
        }
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut state = self.begin(Op::Write, path)?;
        state.check_place(path)?;
        state.put(path, bytes.to_vec());
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.begin(Op::Remove, path)?.files.remove(path);
        Ok(())
    }

    fn remove_empty(&self, _: &Path) -> io::Result<bool> {
        Ok(false) // Folders are there while files are in them.
    }

    fn list(&self, folder: &Path) -> io::Result<Vec<PathBuf>> {
        let state = self.begin(Op::List, folder)?;
        match state.files.contains_key(folder) {
            true => Err(ErrorKind::NotADirectory.into()),
            false => Ok(state.files.keys().filter(|p| p.starts_with(folder)).cloned().collect()),
        }
    }

    fn try_lock(&self, path: &Path) -> io::Result<Option<Box<dyn Lock>>> {
        let mut state = self.begin(Op::Lock, path)?;
        state.check_place(path)?;
        let free = state.locked.insert(path.to_path_buf());
        Ok(free.then(|| Box::new(Held { state: self.state.clone(), path: path.to_path_buf() }) as Box<dyn Lock>))
    }
}

struct Held {
    state: Arc<Mutex<State>>,
    path: PathBuf,
}

impl Lock for Held {}

impl Drop for Held {
    fn drop(&mut self) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).locked.remove(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_hit_the_call_they_are_laid_for_and_calls_are_noted() {
        let disk = Memory::new();
        let path = Path::new("/a");
        disk.write(path, b"old").unwrap();
        disk.break_at(Op::Write, "/a", ErrorKind::StorageFull);
        assert_eq!(disk.write(path, b"new").unwrap_err().kind(), ErrorKind::StorageFull);
        assert_eq!(disk.read(path, 3).unwrap(), b"old");
        disk.mend();
        disk.write(path, b"new").unwrap();
        let ops: Vec<Op> = disk.take_log().into_iter().map(|(op, _)| op).collect();
        assert_eq!(ops, [Op::Write, Op::Write, Op::Read, Op::Write]);
        assert!(disk.take_log().is_empty());
    }

    #[test]
    fn touching_moves_the_time_and_keeps_the_bytes() {
        let disk = Memory::new();
        let path = Path::new("/a");
        disk.write(path, b"x").unwrap();
        let before = disk.stamp(path).unwrap().unwrap();
        disk.touch(path).unwrap();
        assert!(disk.stamp(path).unwrap().unwrap().mtime_ns > before.mtime_ns);
        assert_eq!(disk.read(path, 1).unwrap(), b"x");
    }
}
