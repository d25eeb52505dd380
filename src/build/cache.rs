//! Artefacts on disk, found by key.
//!
//! `steps/<2 hex>/<key>` records which artefact a step of that key gave; `blobs/<2 hex>/<digest>` holds the bytes. Both
//! appear whole or not at all and are checked when read: a damaged or missing one is a miss, and what it held is made
//! again. Steps of different keys with the same bytes share a blob.
//!
//! Unaware of: what a step is, what the bytes mean.

use std::io;
use std::path::{Path, PathBuf};

use super::codec::{Writer, open_frame};
use super::digest::Digest;
use crate::disk::Disk;

const RECORD_MAGIC: &[u8; 8] = b"KILNREC1";
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

    /// The bytes of an artefact. A damaged blob is removed and `None` returned, as for a missing one.
    pub fn load(&self, artefact: &Digest, len: u64) -> Option<Vec<u8>> {
        let path = self.path("blobs", artefact);
        match self.disk.read(&path, len) {
            Ok(bytes) if bytes.len() as u64 == len && Digest::of(&bytes) == *artefact => Some(bytes),
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

    /// Removes artefacts, longest unwritten first, until at most `max_bytes` are left, and the records of those
    /// removed. Returns what is left.
    pub fn trim(&self, max_bytes: u64) -> io::Result<Size> {
        let mut blobs = Vec::new();
        for (path, digest) in self.entries("blobs")? {
            if let Some(stamp) = self.disk.stamp(&path)? {
                blobs.push((stamp.mtime_ns, digest, stamp.len, path));
            }
        }
        blobs.sort_unstable();
        let mut bytes: u64 = blobs.iter().map(|blob| blob.2).sum();
        for (_, _, len, path) in &blobs {
            if bytes <= max_bytes {
                break;
            }
            self.disk.remove(path)?;
            bytes -= len;
        }
        for (path, key) in self.entries("steps")? {
            if self.record(&key).is_none_or(|record| !self.has(&record.artefact, record.len)) {
                self.disk.remove(&path)?;
            }
        }
        self.size()
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
    let hash = blake3::Hash::from_hex(path.file_name()?.to_str()?).ok()?;
    Some(Digest::from_bytes(*hash.as_bytes()))
}
