//! The only door to the file system.
//!
//! [`Real`] is the file system; [`Memory`] is one in memory, with times that only move on a write, for tests of the
//! engine. Errors are `std::io::Error`s whose text does not name the path; callers add it.

mod jobserver;
mod memory;
mod real;

pub use jobserver::Jobserver;
pub use memory::{Memory, Op};
pub use real::{Real, TEMPORARY_PREFIX, is_temporary, machine_memory};

use std::io::{self, Cursor, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// What tells, without reading it, whether a file may have changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp {
    /// Length in bytes.
    pub len: u64,
    /// Modification time in nanoseconds since 1970.
    pub mtime_ns: i128,
    /// Inode or file index; 0 where there is none.
    pub inode: u64,
}

/// Two edits this close may share one time stamp (FAT counts in steps of two seconds).
const COARSEST_CLOCK_NS: i128 = 2_000_000_000;

/// Tells which stamps can be trusted to move when their files are written again. "Now" is asked of the file system itself,
/// which may be another machine's, when it is needed first.
pub struct Clock<'a> {
    disk: &'a dyn Disk,
    probe: PathBuf,
    now: OnceLock<Option<i128>>,
}

impl<'a> Clock<'a> {
    /// A clock that writes the file `probe` to see its time.
    pub fn new(disk: &'a dyn Disk, probe: impl Into<PathBuf>) -> Self {
        Clock { disk, probe: probe.into(), now: OnceLock::new() }
    }

    /// A clock that writes nothing and trusts nothing.
    pub fn stopped(disk: &'a dyn Disk) -> Self {
        Clock { disk, probe: PathBuf::new(), now: OnceLock::from(None) }
    }

    /// The time when it was first asked, in nanoseconds since 1970; `None` if the probe cannot be written.
    pub fn now(&self) -> Option<i128> {
        let ask = || {
            self.disk.write(&self.probe, b"").ok()?;
            Some(self.disk.stamp(&self.probe).ok()??.mtime_ns)
        };
        *self.now.get_or_init(ask)
    }

    /// Whether a stamp is so old that whatever is written from now on will have another one.
    pub fn trusts(&self, stamp: &Stamp) -> bool {
        self.now().is_some_and(|now| stamp.mtime_ns + COARSEST_CLOCK_NS <= now)
    }
}

/// A file that is being written: what is written first may be corrected later.
pub trait Sink: Write + Seek + Send {}

impl<T: Write + Seek + Send> Sink for T {}

/// Held while work goes on that two processes must not do at once; dropping it lets the next one in.
pub trait Lock: Send {}

/// A file system: the real one, or one in memory for tests of the engine.
///
/// Errors are `std::io::Error`s whose text does not name the path; callers add it.
pub trait Disk: Send + Sync {
    /// The whole file; refuses one larger than `limit` bytes before reading it (`ErrorKind::FileTooLarge`), and what
    /// is not a file: a folder (`IsADirectory`), a pipe or device (`InvalidInput`).
    fn read(&self, path: &Path, limit: u64) -> io::Result<Vec<u8>>;
    /// Stamp of a file; `None` if there is no such file. A folder is an error (`IsADirectory`).
    fn stamp(&self, path: &Path) -> io::Result<Option<Stamp>>;
    /// Writes a whole file: it appears complete or not at all, also after a kill or on a full disk. Makes missing
    /// folders. A power cut may lose it: enough for whatever is checked when read, such as cache entries.
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;
    /// As [`Disk::write`], and on the medium when it returns: for what nobody checks later, such as outputs.
    fn write_synced(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.write(path, bytes)
    }
    /// As [`Disk::write`], for what is too large to be held: `fill` writes it piece by piece. If that fails, nothing appears.
    fn write_with(&self, path: &Path, fill: &mut dyn FnMut(&mut dyn Sink) -> io::Result<()>) -> io::Result<()> {
        let mut whole = Cursor::new(Vec::new());
        fill(&mut whole)?;
        self.write(path, &whole.into_inner())
    }
    /// Sets the modification time of a file to now.
    fn touch(&self, path: &Path) -> io::Result<()>;
    /// Removes a file; no error if it is not there.
    fn remove(&self, path: &Path) -> io::Result<()>;
    /// Removes a folder that has nothing in it; says whether there was such a folder.
    fn remove_empty(&self, folder: &Path) -> io::Result<bool>;
    /// Files below a folder (recursively, not through links to folders), sorted; empty if there is no such folder.
    fn list(&self, folder: &Path) -> io::Result<Vec<PathBuf>>;
    /// Takes the advisory lock that the file at `path` stands for, making the file where it is missing; `None` if
    /// another holder has it. Unreliable on old network file systems: a courtesy, never what keeps files whole.
    fn try_lock(&self, path: &Path) -> io::Result<Option<Box<dyn Lock>>>;
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::ErrorKind;

    /// What every disk promises, below the folder `root`.
    fn contract(disk: &dyn Disk, root: &Path) {
        let at = |name: &str| root.join(name);
        assert_eq!(disk.read(&at("a/b"), 9).unwrap_err().kind(), ErrorKind::NotFound);
        assert_eq!(disk.stamp(&at("a/b")).unwrap(), None);
        assert_eq!(disk.list(&at("a")).unwrap(), Vec::<PathBuf>::new());
        disk.remove(&at("a/b")).unwrap();

        disk.write(&at("a/b"), b"12345").unwrap();
        assert_eq!(disk.read(&at("a/b"), 5).unwrap(), b"12345");
        assert_eq!(disk.read(&at("a/b"), 4).unwrap_err().kind(), ErrorKind::FileTooLarge);
        let old = disk.stamp(&at("a/b")).unwrap().unwrap();
        assert_eq!(old.len, 5);
        disk.write_synced(&at("a/b"), b"54321").unwrap();
        assert_eq!(disk.read(&at("a/b"), 5).unwrap(), b"54321");
        assert_ne!(disk.stamp(&at("a/b")).unwrap().unwrap(), old, "a replaced file has another stamp");

        let pieces = &mut |sink: &mut dyn Sink| {
            sink.write_all(b"?????ces")?;
            sink.seek(std::io::SeekFrom::Start(0))?;
            sink.write_all(b"in pie")
        };
        disk.write_with(&at("a/b"), pieces).unwrap();
        assert_eq!(disk.read(&at("a/b"), 8).unwrap(), b"in piees");
        let fails = &mut |sink: &mut dyn Sink| {
            sink.write_all(b"half")?;
            Err(ErrorKind::InvalidData.into())
        };
        assert_eq!(disk.write_with(&at("a/b"), fails).unwrap_err().kind(), ErrorKind::InvalidData);
        assert!(disk.write_with(&at("a/half"), fails).is_err());
        assert_eq!(disk.read(&at("a/b"), 8).unwrap(), b"in piees");
        assert_eq!(disk.list(&at("a")).unwrap(), [at("a/b")]);

        // Folders are not files, and files are not folders.
        assert_eq!(disk.read(&at("a"), 9).unwrap_err().kind(), ErrorKind::IsADirectory);
        assert_eq!(disk.stamp(&at("a")).unwrap_err().kind(), ErrorKind::IsADirectory);
        assert!(disk.write(&at("a"), b"x").is_err());
        assert!(disk.write(&at("a/b/c"), b"x").is_err());
        assert_eq!(disk.stamp(&at("a/b/c")).unwrap(), None);

        disk.write(&at("a/c/d"), b"").unwrap();
        disk.write(&at("a.txt"), b"").unwrap();
        assert_eq!(disk.list(&at("a")).unwrap(), [at("a/b"), at("a/c/d")]);
        disk.remove(&at("a/b")).unwrap();
        assert!(!disk.remove_empty(&at("a")).unwrap() && !disk.remove_empty(&at("a/c")).unwrap());
        assert_eq!(disk.list(root).unwrap(), [at("a/c/d"), at("a.txt")]);

        let held = disk.try_lock(&at("locks/one")).unwrap();
        assert!(held.is_some());
        assert!(disk.try_lock(&at("locks/one")).unwrap().is_none());
        drop(held);
        assert!(disk.try_lock(&at("locks/one")).unwrap().is_some());
    }

    #[test]
    fn the_real_disk_keeps_the_contract() {
        let folder = tempfile::tempdir().unwrap();
        contract(&Real, folder.path());
    }

    #[test]
    fn the_disk_in_memory_keeps_the_contract() {
        contract(&Memory::new(), Path::new("/root"));
    }
}
