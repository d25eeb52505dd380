//! A file that is there while kiln writes: one that is found tells that its kiln was killed.
//!
//! Unaware of: what is written.

use std::path::{Path, PathBuf};

use crate::disk::{Disk, Lock, Real};

/// The marker of a run; dropping it ends the run.
pub(super) struct Marker {
    path: PathBuf,
    /// `None`: another kiln is at work here, and the marker is that one's.
    lock: Option<Box<dyn Lock>>,
    /// An earlier run was killed, and nobody else is at work here.
    pub found: bool,
}

impl Marker {
    /// Sets the marker, before anything is written.
    pub fn set(path: &Path) -> Self {
        let found = matches!(Real.stamp(path), Ok(Some(_)));
        // Where locks or files cannot be had, nothing is cleaned up.
        let lock = Real.try_lock(path).ok().flatten();
        Marker { path: path.to_path_buf(), found: found && lock.is_some(), lock }
    }
}

impl Drop for Marker {
    fn drop(&mut self) {
        if self.lock.is_some() {
            // At worst the next run looks for what this one did not leave.
            let _ = Real.remove(&self.path);
        }
    }
}
