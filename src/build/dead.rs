//! What should not be there: outputs of recipes that are gone, unfinished files of runs that were killed.
//!
//! The manifest knows every file that kiln wrote. One that no step of the whole tree writes any more is dead; it is
//! reported as long as it is there, and removed if that is asked for. A file that somebody else has written since is
//! theirs: it is forgotten, not removed.
//!
//! Unaware of: recipes.

use std::path::{Path, PathBuf};

use super::digest::Digest;
use super::manifest::FileRecord;
use super::survey::World;
use crate::disk::is_temporary;

/// What became of the outputs that nobody writes any more.
#[derive(Default)]
pub(super) struct Dead {
    /// Those that are there, or were until now.
    pub found: Vec<PathBuf>,
    /// Names of those to be forgotten.
    pub gone: Vec<Vec<u8>>,
    /// Why some could not be removed.
    pub warnings: Vec<String>,
}

/// Looks for dead outputs, and removes them if that was asked for.
pub(super) fn sweep(world: &World) -> Dead {
    let mut dead = Dead::default();
    let outputs = &world.graph.outputs;
    if !world.options.whole_tree {
        return dead;
    }
    let name = |index: usize| outputs[index].path.as_os_str().as_encoded_bytes();
    for (name, record) in world.manifest.outputs.others(outputs.len(), &name) {
        // Paths that are not UTF-8 are left alone.
        let Ok(path) = std::str::from_utf8(name).map(Path::new) else { continue };
        if !is_ours(world, path, record) {
            dead.gone.push(name.to_vec());
            continue;
        }
        dead.found.push(path.to_path_buf());
        if world.options.prune && !world.options.dry_run {
            match world.disk.remove(path) {
                Ok(()) => {
                    dead.gone.push(name.to_vec());
                    remove_emptied(world, path);
                }
                Err(error) => dead.warnings.push(format!("{} cannot be removed: {error}", path.display())),
            }
        }
    }
    dead
}

/// Removes the folders that a removed file leaves empty.
fn remove_emptied(world: &World, file: &Path) {
    for folder in file.ancestors().skip(1).take_while(|folder| *folder != Path::new("")) {
        if !matches!(world.disk.remove_empty(folder), Ok(true)) {
            return;
        }
    }
}

/// Whether the file is there as kiln wrote it.
fn is_ours(world: &World, path: &Path, record: &FileRecord) -> bool {
    match world.disk.stamp(path) {
        Ok(Some(stamp)) if record.stamp == Some(stamp) => true,
        Ok(Some(_)) => {
            let bytes = world.disk.read(path, world.options.file_limit);
            bytes.is_ok_and(|bytes| Digest::of(&bytes) == record.digest)
        }
        _ => false,
    }
}

/// Removes unfinished files that are not newer than this time from the folders of the outputs and from kiln's own, but
/// for those that another kiln is writing. They do no harm, so those that cannot be removed stay.
pub(super) fn remove_unfinished(world: &World, until_ns: i128) {
    let mut folders: Vec<&Path> = world.graph.outputs.iter().filter_map(|output| output.path.parent()).collect();
    folders.extend(world.options.manifest.parent());
    folders.sort_unstable();
    // Lists are recursive. In this order what is below a folder comes right after it.
    folders.dedup_by(|folder, above| folder.starts_with(above));
    for folder in folders.into_iter().filter(|folder| *folder != Path::new("")) {
        for path in world.disk.list(folder).unwrap_or_default() {
            let temporary = path.file_name().and_then(|name| name.to_str()).is_some_and(is_temporary);
            // Times tell ticks apart, and a tick is long enough to be killed in and started again.
            let old = |path| matches!(world.disk.stamp(path), Ok(Some(stamp)) if stamp.mtime_ns <= until_ns);
            if !temporary || !old(&path) {
                continue;
            }
            // Whoever writes it holds its lock. It is held until the file is gone, lest another take it up.
            if let Ok(Some(_lock)) = world.disk.try_lock(&path) {
                let _ = world.disk.remove(&path);
            }
        }
    }
}
