//! Artefacts on disk, found by key.
//!
//! `steps/<2 hex>/<key>` records which artefact a step of that key gave; `blobs/<2 hex>/<digest>` holds the bytes. Both
//! appear whole or not at all and are checked when read: a damaged or missing one is a miss, and what it held is made
//! again. Steps of different keys with the same bytes share a blob.
//!
//! Unaware of: what a step is, what the bytes mean.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::codec::{Writer, open_frame};
use super::digest::Digest;
use crate::disk::{Clock, Disk, is_temporary};

const RECORD_MAGIC: &[u8; 8] = b"KILNREC1";
/// Whatever is unfinished for a day will not be finished: the kiln that wrote it is dead, on whichever machine it ran.
const ABANDONED_NS: i128 = 86_400 * 1_000_000_000;
/// A record is 92 bytes; whatever is longer is none.
const RECORD_LIMIT: u64 = 256;

/// Which artefact a key gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// Digest of the artefact's bytes.
    pub artefact: Digest,
    /// Length of the artefact in bytes.
    pub len: u64,
    /// How long the step took, in milliseconds.
    pub wall_ms: u64,
}

/// What the cache holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Size {
    /// How many records.
    pub records: usize,
    /// How many artefacts.
    pub blobs: usize,
    /// Bytes of all artefacts.
    pub bytes: u64,
}

/// What was copied from one cache to another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Copied {
    /// How many records, and what artefacts the other did not have.
    pub size: Size,
    /// Entries that were left out, as they are damaged.
    pub damaged: usize,
}

/// A cache folder.
pub struct Cache<'a> {
    disk: &'a dyn Disk,
    folder: PathBuf,
}

impl<'a> Cache<'a> {
    /// The cache in `folder`, which need not exist yet.
    pub fn new(disk: &'a dyn Disk, folder: impl Into<PathBuf>) -> Self {
        Cache { disk, folder: folder.into() }
    }

    /// The record under `key`; `None` if there is none or it is damaged.
    pub fn record(&self, key: &Digest) -> Option<Record> {
        let frame = self.disk.read(&self.path("steps", key), RECORD_LIMIT).ok()?;
        let mut reader = open_frame(RECORD_MAGIC, &frame)?;
        let (stored, artefact) = (reader.digest()?, reader.digest()?);
        let record = Record { artefact, len: reader.u64()?, wall_ms: reader.u64()? };
        (stored == *key).then_some(record)
    }

    /// Stores an artefact and then its record.
    pub fn store(&self, key: &Digest, record: &Record, artefact: &[u8]) -> io::Result<()> {
        debug_assert_eq!(record.len, artefact.len() as u64);
        if !self.has(&record.artefact, record.len) {
            self.disk.write(&self.path("blobs", &record.artefact), artefact)?;
        }
        self.store_record(key, record)
    }

    fn store_record(&self, key: &Digest, record: &Record) -> io::Result<()> {
        let mut writer = Writer::new(RECORD_MAGIC);
        writer.digest(key);
        writer.digest(&record.artefact);
        writer.u64(record.len);
        writer.u64(record.wall_ms);
        self.disk.write(&self.path("steps", key), &writer.finish())
    }

    /// Whether a blob of this digest and length is there, by its stamp only.
    pub fn has(&self, artefact: &Digest, len: u64) -> bool {
        let stamp = self.disk.stamp(&self.path("blobs", artefact));
        matches!(stamp, Ok(Some(stamp)) if stamp.len == len)
    }

    /// The bytes of an artefact, if they are there and sound.
    fn peek(&self, artefact: &Digest, len: u64) -> Option<Vec<u8>> {
        let bytes = self.disk.read(&self.path("blobs", artefact), len).ok()?;
        (bytes.len() as u64 == len && Digest::of(&bytes) == *artefact).then_some(bytes)
    }

    /// The bytes of an artefact, which count as used now. A damaged blob is removed and `None` returned, as for a missing
    /// one.
    pub fn load(&self, artefact: &Digest, len: u64) -> Option<Vec<u8>> {
        let path = self.path("blobs", artefact);
        match self.disk.read(&path, len) {
            Ok(bytes) if bytes.len() as u64 == len && Digest::of(&bytes) == *artefact => {
                // Only the order of trimming hangs on it: a cache that one may only read is as good.
                let _ = self.disk.touch(&path);
                Some(bytes)
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            // Too long, too short, other bytes, unreadable: out of the way, so that `store` writes it anew.
            _ => {
                let _ = self.disk.remove(&path);
                None
            }
        }
    }

    /// Counts what is there.
    pub fn size(&self) -> io::Result<Size> {
        let blobs = self.entries("blobs")?;
        let mut size = Size { records: self.entries("steps")?.len(), blobs: blobs.len(), bytes: 0 };
        for (path, _) in &blobs {
            size.bytes += self.disk.stamp(path)?.map_or(0, |stamp| stamp.len);
        }
        Ok(size)
    }

    /// Reads everything, removes what is damaged, and returns the removed files.
    pub fn verify(&self) -> io::Result<Vec<PathBuf>> {
        let mut damaged = Vec::new();
        for (path, key) in self.entries("steps")? {
            if self.record(&key).is_none() {
                damaged.push(path);
            }
        }
        for (path, digest) in self.entries("blobs")? {
            let Some(stamp) = self.disk.stamp(&path)? else { continue };
            if self.load(&digest, stamp.len).is_none() {
                damaged.push(path);
            }
        }
        damaged.iter().try_for_each(|path| self.disk.remove(path))?;
        Ok(damaged)
    }

    /// Removes artefacts that were not used for `max_age`, and those longest not used until at most `max_bytes` are left;
    /// those in `used` (sorted) go last and do not age. Removes the records of those removed, and what killed runs left
    /// behind. Returns what is left.
    pub fn trim(&self, max_bytes: Option<u64>, max_age: Option<Duration>, used: &[Digest]) -> io::Result<Size> {
        let now = self.now()?;
        let mut blobs = Vec::new();
        for (path, digest) in self.entries("blobs")? {
            if let Some(stamp) = self.disk.stamp(&path)? {
                blobs.push((used.binary_search(&digest).is_ok(), stamp.mtime_ns, digest, stamp.len, path));
            }
        }
        blobs.sort_unstable();
        let mut bytes: u64 = blobs.iter().map(|blob| blob.3).sum();
        let before = bytes;
        for (used, mtime_ns, _, len, path) in &blobs {
            let old = !used && max_age.is_some_and(|age| mtime_ns + (age.as_nanos() as i128) < now);
            if old || max_bytes.is_some_and(|most| bytes > most) {
                self.disk.remove(path)?;
                bytes -= len;
            }
        }
        self.remove_temporaries(now - ABANDONED_NS)?;
        let records = if bytes < before { self.entries("steps")? } else { Vec::new() };
        for (path, key) in records {
            if self.record(&key).is_none_or(|record| !self.has(&record.artefact, record.len)) {
                self.disk.remove(&path)?;
            }
        }
        self.size()
    }

    /// Copies records and their artefacts, those in `used` (sorted) or all, to another cache. Entries are checked on the
    /// way; a damaged one is left out.
    pub fn copy_to(&self, to: &Cache, used: Option<&[Digest]>) -> io::Result<Copied> {
        let mut copied = Copied::default();
        for (_, key) in self.entries("steps")? {
            let Some(record) = self.record(&key) else {
                copied.damaged += 1;
                continue;
            };
            if used.is_some_and(|used| used.binary_search(&record.artefact).is_err()) {
                continue;
            }
            if !to.has(&record.artefact, record.len) {
                let Some(bytes) = self.peek(&record.artefact, record.len) else {
                    copied.damaged += 1;
                    continue;
                };
                copied.size.blobs += 1;
                copied.size.bytes += record.len;
                to.store(&key, &record, &bytes)?;
            } else if to.record(&key) != Some(record) {
                to.store_record(&key, &record)?;
            }
            copied.size.records += 1;
        }
        Ok(copied)
    }

    /// The time by the clock that stamps the files of the cache.
    fn now(&self) -> io::Result<i128> {
        let now = Clock::new(self.disk, self.folder.join("clock")).now();
        now.ok_or_else(|| io::Error::new(io::ErrorKind::PermissionDenied, "cannot be written to"))
    }

    /// Removes unfinished files of killed runs that are older than this time.
    fn remove_temporaries(&self, before_ns: i128) -> io::Result<()> {
        for path in self.disk.list(&self.folder)? {
            let is_temporary = path.file_name().and_then(|name| name.to_str()).is_some_and(is_temporary);
            if is_temporary && self.disk.stamp(&path)?.is_some_and(|stamp| stamp.mtime_ns < before_ns) {
                self.disk.remove(&path)?;
            }
        }
        Ok(())
    }

    /// Removes every record and artefact, and nothing else that may lie in the folder.
    pub fn clear(&self) -> io::Result<()> {
        for (path, _) in self.entries("steps")?.iter().chain(&self.entries("blobs")?) {
            self.disk.remove(path)?;
        }
        Ok(())
    }

    fn path(&self, kind: &str, digest: &Digest) -> PathBuf {
        let hex = digest.to_string();
        self.folder.join(kind).join(&hex[..2]).join(&hex)
    }

    /// Files of one kind that lie where [`Cache::path`] puts them.
    fn entries(&self, kind: &str) -> io::Result<Vec<(PathBuf, Digest)>> {
        let files = self.disk.list(&self.folder.join(kind))?;
        let known = |path: PathBuf| {
            let digest = digest_of_name(&path)?;
            (path == self.path(kind, &digest)).then_some((path, digest))
        };
        Ok(files.into_iter().filter_map(known).collect())
    }
}

fn digest_of_name(path: &Path) -> Option<Digest> {
    Digest::from_hex(path.file_name()?.to_str()?)
}
