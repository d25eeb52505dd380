//! The file system itself.

use super::{Disk, Lock, Sink, Stamp};
use std::fs;
use std::io::{self, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// How the names of unfinished files begin. A killed run may leave one behind; whoever trims a folder may remove it.
pub const TEMPORARY_PREFIX: &str = ".kiln-tmp-";

/// Whether a file of this name is unfinished: being written, or left behind by a run that was killed.
pub fn is_temporary(name: &str) -> bool {
    name.starts_with(TEMPORARY_PREFIX)
}

/// How much memory the machine has for this process, in bytes: what is built in or what its control group allows,
/// whichever is less. `None` where the system does not say it in a file.
pub fn machine_memory() -> Option<u64> {
    let number = |text: &str| text.trim().parse::<u64>().ok();
    let group = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];
    let group = group.iter().filter_map(|path| number(&fs::read_to_string(path).ok()?)).min();
    let info = fs::read_to_string("/proc/meminfo").ok();
    let total = info.iter().flat_map(|text| text.lines()).find_map(|line| {
        let kib = line.strip_prefix("MemTotal:")?.strip_suffix("kB")?;
        Some(number(kib)? * 1024)
    });
    group.into_iter().chain(total).min()
}

/// The real file system.
#[derive(Clone, Copy, Debug, Default)]
pub struct Real;

impl Disk for Real {
    fn read(&self, path: &Path, limit: u64) -> io::Result<Vec<u8>> {
        // Before opening: opening a pipe would wait for a writer.
        let meta = fs::metadata(path)?;
        if meta.is_dir() {
            return Err(ErrorKind::IsADirectory.into());
        }
        if !meta.is_file() {
            return Err(io::Error::new(ErrorKind::InvalidInput, "is not a regular file"));
        }
        let too_large =
            |len: u64| io::Error::new(ErrorKind::FileTooLarge, format!("has {len} bytes, at most {limit} are read"));
        if meta.len() > limit {
            return Err(too_large(meta.len()));
        }
        // The file may grow while it is read: one byte more than allowed tells.
        let mut bytes = Vec::with_capacity(meta.len() as usize);
        fs::File::open(path)?.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > limit { Err(too_large(bytes.len() as u64)) } else { Ok(bytes) }
    }

    fn stamp(&self, path: &Path) -> io::Result<Option<Stamp>> {
        match fs::metadata(path) {
            Ok(meta) if meta.is_dir() => Err(ErrorKind::IsADirectory.into()),
            Ok(meta) => Ok(Some(Stamp { len: meta.len(), mtime_ns: mtime_ns(&meta)?, inode: inode(&meta) })),
            Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
            Err(e) => Err(e),
        }
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        write_whole(path, Sync::No, |file| file.write_all(bytes))
    }

    fn write_synced(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        write_whole(path, Sync::Yes, |file| file.write_all(bytes))
    }

    fn write_with(&self, path: &Path, fill: &mut dyn FnMut(&mut dyn Sink) -> io::Result<()>) -> io::Result<()> {
        write_whole(path, Sync::No, |file| {
            let mut buffered = BufWriter::with_capacity(1 << 16, file);
            fill(&mut buffered)?;
            buffered.flush()
        })
    }

    fn touch(&self, path: &Path) -> io::Result<()> {
        fs::File::options().append(true).open(path)?.set_modified(SystemTime::now())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        match fs::remove_file(path) {
            Err(e) if !matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Err(e),
            _ => Ok(()),
        }
    }

    fn remove_empty(&self, folder: &Path) -> io::Result<bool> {
        match fs::remove_dir(folder) {
            Ok(()) => Ok(true),
            Err(e) if matches!(e.kind(), ErrorKind::DirectoryNotEmpty | ErrorKind::NotFound) => Ok(false),
            Err(e) => Err(e),
        }
    }

    fn list(&self, folder: &Path) -> io::Result<Vec<PathBuf>> {
        let mut files = Vec::new();
        let mut folders = vec![folder.to_path_buf()];
        while let Some(next) = folders.pop() {
            let entries = match fs::read_dir(&next) {
                Ok(entries) => entries,
                // It never was there, or went away meanwhile.
                Err(e) if e.kind() == ErrorKind::NotFound => continue,
                Err(e) => return Err(e),
            };
            for entry in entries {
                let entry = entry?;
                let kind = entry.file_type()?;
                if kind.is_dir() {
                    folders.push(entry.path());
                } else if kind.is_file() || fs::metadata(entry.path()).is_ok_and(|m| m.is_file()) {
                    files.push(entry.path());
                }
            }
        }
        files.sort();
        Ok(files)
    }

    fn try_lock(&self, path: &Path) -> io::Result<Option<Box<dyn Lock>>> {
        if let Some(folder) = folder_of(path) {
            fs::create_dir_all(folder)?;
        }
        let file = fs::OpenOptions::new().write(true).create(true).truncate(false).open(path)?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Box::new(file))),
            Err(fs::TryLockError::WouldBlock) => Ok(None),
            Err(fs::TryLockError::Error(e)) => Err(e),
        }
    }
}

/// The operating system lets go of the lock when the file is closed, also by a kill.
impl Lock for fs::File {}

#[derive(Clone, Copy, PartialEq)]
enum Sync {
    Yes,
    No,
}

/// A temporary file in the same folder, renamed over the target; dropped, hence removed, on any failure before that.
fn write_whole(
    path: &Path,
    sync: Sync,
    fill: impl FnOnce(&mut tempfile::NamedTempFile) -> io::Result<()>,
) -> io::Result<()> {
    let folder = folder_of(path).unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY_PREFIX);
    // Temporary files are private by default; this one becomes an ordinary file, so the umask decides.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder).map_err(plain)?;
    // Tells whoever cleans up that somebody is still at work on it. Where a lock also keeps readers out, none is taken.
    #[cfg(unix)]
    let _ = file.as_file().try_lock();
    fill(&mut file).map_err(plain)?;
    if sync == Sync::Yes {
        file.as_file().sync_all()?;
    }
    file.persist(path).map_err(|e| e.error)?;
    #[cfg(unix)]
    if sync == Sync::Yes {
        // The new name is part of the folder.
        fs::File::open(folder)?.sync_all()?;
    }
    Ok(())
}

/// `tempfile` names the temporary path in its errors, which would only puzzle.
fn plain(e: io::Error) -> io::Error {
    e.get_ref()
        .and_then(|inner| inner.source())
        .and_then(|cause| cause.downcast_ref::<io::Error>())
        .map(|cause| cause.raw_os_error().map_or_else(|| cause.kind().into(), io::Error::from_raw_os_error))
        .unwrap_or(e)
}

fn folder_of(path: &Path) -> Option<&Path> {
    path.parent().filter(|p| !p.as_os_str().is_empty())
}

fn mtime_ns(meta: &fs::Metadata) -> io::Result<i128> {
    let time = meta.modified()?;
    Ok(match time.duration_since(std::time::UNIX_EPOCH) {
        Ok(after) => after.as_nanos() as i128,
        Err(before) => -(before.duration().as_nanos() as i128),
    })
}

#[cfg(unix)]
fn inode(meta: &fs::Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::ino(meta)
}

#[cfg(not(unix))]
fn inode(_: &fs::Metadata) -> u64 {
    0
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_failed_write_leaves_nothing_and_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("file");
        fs::create_dir(&target).unwrap();
        fs::write(target.join("inside"), b"kept").unwrap();
        let error = Real.write(&target, b"new").unwrap_err();
        assert!(!error.to_string().contains(TEMPORARY_PREFIX), "{error}");
        assert_eq!(Real.list(folder.path()).unwrap(), [target.join("inside")]);

        // A file where a folder should be.
        let error = Real.write(&target.join("inside/deeper"), b"new").unwrap_err();
        assert!(!error.to_string().contains("inside"), "{error}");
        assert_eq!(fs::read(target.join("inside")).unwrap(), b"kept");
    }

    #[test]
    fn a_file_is_locked_while_it_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("file");
        let fill = &mut |sink: &mut dyn Sink| {
            sink.write_all(b"whole")?;
            let unfinished = Real.list(folder.path())?;
            assert!(unfinished.len() == 1 && is_temporary(unfinished[0].file_name().unwrap().to_str().unwrap()));
            assert!(Real.try_lock(&unfinished[0])?.is_none());
            Ok(())
        };
        Real.write_with(&target, fill).unwrap();
        assert_eq!(Real.list(folder.path()).unwrap(), [&*target]);
        assert!(Real.try_lock(&target).unwrap().is_some());
    }

    #[test]
    fn written_files_have_the_permissions_of_ordinary_ones() {
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        Real.write(&ours, b"").unwrap();
        fs::write(&plain, b"").unwrap();
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_machine_has_memory() {
        assert!(machine_memory().is_some_and(|bytes| bytes > 64 << 20));
    }

    #[test]
    fn what_is_not_a_file_is_refused_without_waiting() {
        let error = Real.read(Path::new("/dev/zero"), 100).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::InvalidInput);
    }

    #[test]
    fn links_to_folders_do_not_make_lists_run_in_circles() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a/file");
        Real.write(&file, b"x").unwrap();
        std::os::unix::fs::symlink(folder.path(), folder.path().join("a/up")).unwrap();
        std::os::unix::fs::symlink(&file, folder.path().join("a/link")).unwrap();
        assert_eq!(Real.list(folder.path()).unwrap(), [file, folder.path().join("a/link")]);
    }

    #[test]
    fn readers_see_the_old_or_the_new_file_never_a_part() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        Real.write(&path, &[0; 100_000]).unwrap();
        std::thread::scope(|s| {
            for value in 1..3u8 {
                let path = &path;
                s.spawn(move || (0..50).for_each(|_| Real.write(path, &[value; 100_000]).unwrap()));
            }
            for _ in 0..200 {
                let bytes = Real.read(&path, 100_000).unwrap();
                assert!(bytes.len() == 100_000 && bytes.iter().all(|b| *b == bytes[0]));
            }
        });
        assert_eq!(Real.list(folder.path()).unwrap(), [path]);
    }
}
