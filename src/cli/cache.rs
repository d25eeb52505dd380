//! `kiln cache`: size, verify, clear.

use std::path::Path;

use crate::build::Cache;
use crate::disk::Real;

use super::args::{self, CacheVerb, Global};
use super::project::{OWN, project};
use super::{Done, Stop};

/// Shows, checks or empties the cache.
pub(super) fn run(global: &Global, args: &args::Cache) -> Result<Done, Stop> {
    let disk = Real;
    let (project, _) = project(&disk)?;
    let folder = project.cache.path.map_or_else(|| Path::new(OWN).join("cache"), |p| p.path);
    let cache = Cache::new(&disk, &folder);
    let fail = |e: std::io::Error| Stop::Failed(format!("{}: {e}", folder.display()));
    match args.what.unwrap_or(CacheVerb::Size) {
        CacheVerb::Size => {
            let size = cache.size().map_err(fail)?;
            let mib = size.bytes as f64 / (1024.0 * 1024.0);
            Done::ok(format!("{}: {} steps, {} artefacts, {mib:.1} MiB\n", folder.display(), size.records, size.blobs))
        }
        CacheVerb::Verify => {
            let damaged = cache.verify().map_err(fail)?;
            let text = match damaged.len() {
                0 => "every entry is sound\n".to_string(),
                n => format!("{n} damaged entries removed; they are made again when needed\n"),
            };
            Ok(Done { text, success: damaged.is_empty() })
        }
        CacheVerb::Clear if global.dry_run => Done::ok(format!("would clear {}\n", folder.display())),
        CacheVerb::Clear => {
            cache.clear().map_err(fail)?;
            Done::ok(format!("{}: cleared\n", folder.display()))
        }
    }
}
