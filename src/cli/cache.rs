//! `kiln cache`: size, verify, trim, export, import, clear.

use crate::build::Size;
use crate::build::{Cache, artefacts};
use crate::disk::{Disk, Real};

use super::args::{self, CacheVerb, Global};
use super::project::{options, project};
use super::{Done, Stop};

/// Shows, checks or empties the cache.
pub(super) fn run(global: &Global, args: &args::Cache) -> Result<Done, Stop> {
    let disk = Real;
    let (project, _) = project(&disk)?;
    let max_cache = project.cache.max_size;
    let options = options(global, &project)?;
    let folder = options.cache.clone();
    let cache = Cache::new(&disk, &folder);
    let fail = |e: std::io::Error| Stop::Failed(format!("{}: {e}", folder.display()));
    let used = || artefacts(&options, &disk);
    match args.what.clone().unwrap_or(CacheVerb::Size) {
        CacheVerb::Size => {
            let size = cache.size().map_err(fail)?;
            Done::ok(format!("{}: {}\n", folder.display(), words(&size)))
        }
        CacheVerb::Verify => {
            let damaged = cache.verify().map_err(fail)?;
            let text = match damaged.len() {
                0 => "every entry is sound\n".to_string(),
                n => format!("{n} damaged entries removed; they are made again when needed\n"),
            };
            Ok(Done { text, success: damaged.is_empty() })
        }
        CacheVerb::Trim { max_size, max_age } => {
            let max_size = max_size.or(max_cache);
            if max_size.is_none() && max_age.is_none() {
                let said = "say --max-size or --max-age, or `max_size` in [cache] of kiln.toml";
                return Err(Stop::Usage(said.into()));
            }
            if global.dry_run {
                return Done::ok(format!("would trim {}\n", folder.display()));
            }
            let left = cache.trim(max_size, max_age, &used()).map_err(fail)?;
            Done::ok(format!("{}: {} left\n", folder.display(), words(&left)))
        }
        CacheVerb::Export { folder: to, .. } | CacheVerb::Import { folder: to } if global.dry_run => {
            Done::ok(format!("would copy between {} and {}\n", folder.display(), to.display()))
        }
        CacheVerb::Export { folder: to, all } => {
            let used = (!all).then(used);
            let copied = cache.copy_to(&Cache::new(&disk, &to), used.as_deref()).map_err(fail)?;
            Done::ok(format!("{}: {} copied\n", to.display(), words(&copied.size)))
        }
        CacheVerb::Import { folder: from } => {
            if disk.list(&from).map_err(fail)?.is_empty() {
                return Err(Stop::Usage(format!("{}: there is nothing to import", from.display())));
            }
            let copied = Cache::new(&disk, &from).copy_to(&cache, None).map_err(fail)?;
            let mut text = format!("{}: {} copied\n", folder.display(), words(&copied.size));
            if copied.damaged > 0 {
                text += &format!("{} damaged entries were left out\n", copied.damaged);
            }
            Ok(Done { text, success: copied.damaged == 0 })
        }
        CacheVerb::Clear if global.dry_run => Done::ok(format!("would clear {}\n", folder.display())),
        CacheVerb::Clear => {
            cache.clear().map_err(fail)?;
            Done::ok(format!("{}: cleared\n", folder.display()))
        }
    }
}

fn words(size: &Size) -> String {
    let mib = size.bytes as f64 / (1024.0 * 1024.0);
    format!("{} steps, {} artefacts, {mib:.1} MiB", size.records, size.blobs)
}
