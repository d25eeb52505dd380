//! `kiln watch`: bake whenever something changes.
//!
//! Files are looked at again and again rather than asking the system for events: a look is one stamp per file, works on
//! network disks as well, has no limit on how many, and takes a small share of the time ([`PAUSES`]). A change is acted
//! on when nothing has changed for a moment, so that an editor that writes three files, or one in three steps, wakes one
//! bake. Whatever a bake comes to, the watch goes on; Ctrl-C ends it.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::disk::{Disk, Real, Stamp};
use crate::numerics::par;

use super::args::{Bake, Global, Recipes};
use super::{Done, Stop, bake, interrupt, project};

/// Shortest time between two looks.
const PAUSE: Duration = Duration::from_millis(200);
/// A pause is so many times as long as a look.
const PAUSES: u32 = 20;

/// The stamps of everything that a bake depends on. What cannot be looked at counts as missing.
type Looks = BTreeMap<PathBuf, Option<Stamp>>;

/// Bakes, waits for a change, bakes again, until somebody asks for the end.
pub(super) fn run(global: &Global, recipes: &Recipes) -> Result<Done, Stop> {
    let interrupt = interrupt::flag();
    loop {
        // Looked at before the bake: what changes meanwhile wakes the next one.
        let known = known(global, recipes);
        let files = || files(recipes, &known);
        let before = look(files());
        // What the bake says goes out at once; what it comes to decides nothing.
        let bake = Bake { recipes: recipes.clone(), prune: false };
        match bake::run(global, &bake) {
            Ok(Done { text, .. }) | Err(Stop::Partly(text)) => say(&mut anstream::stdout(), &text),
            Err(Stop::Usage(text) | Stop::Failed(text)) => {
                say(&mut anstream::stderr(), &format!("{}\n", text.trim_end()))
            }
            Err(Stop::Interrupted) => return Err(Stop::Interrupted),
        }
        if !global.quiet {
            say(&mut anstream::stderr(), "waiting for changes; Ctrl-C ends\n");
        }
        if !wait(before, files, || interrupt.load(Ordering::Relaxed)) {
            return Err(Stop::Interrupted);
        }
    }
}

fn say(to: &mut impl Write, text: &str) {
    let _ = to.write_all(text.as_bytes()).and_then(|()| to.flush());
}

/// Waits until something is not as it was and has been quiet for a pause; false if somebody asked for the end.
fn wait(before: Looks, files: impl Fn() -> Vec<PathBuf>, ended: impl Fn() -> bool) -> bool {
    let mut last = before.clone();
    loop {
        let begun = Instant::now();
        let now = look(files());
        if now != before && now == last {
            return true;
        }
        last = now;
        let pause = PAUSE.max(begun.elapsed() * PAUSES);
        let until = Instant::now() + pause;
        while Instant::now() < until {
            if ended() {
                return false;
            }
            std::thread::sleep(PAUSE.min(Duration::from_millis(50)));
        }
    }
}

fn look(files: Vec<PathBuf>) -> Looks {
    let stamps = par::map(files.len(), |index| Real.stamp(&files[index]).ok().flatten());
    files.into_iter().zip(stamps).collect()
}

/// What the recipes depend on, as far as they are right.
fn known(global: &Global, recipes: &Recipes) -> Vec<PathBuf> {
    let mut files = vec![PathBuf::from("kiln.toml")];
    let keep_going = Global { keep_going: true, dry_run: true, ..global.clone() };
    if let Ok(loaded) = project::load(&keep_going, &recipes.recipes) {
        files.extend(loaded.graph.files().map(Path::to_path_buf));
        files.extend(loaded.recipe_files);
    }
    files
}

/// What to look at: what is known, and whatever there is beside the recipes, as what a recipe misses may come.
fn files(recipes: &Recipes, known: &[PathBuf]) -> Vec<PathBuf> {
    let mut files = known.to_vec();
    files.extend(recipes.recipes.iter().cloned());
    let named = recipes.recipes.iter().filter_map(|recipe| recipe.parent());
    let folders = named.filter(|folder| *folder != Path::new("")).chain([Path::new("recipes")]);
    folders.for_each(|folder| files.extend(Real.list(folder).unwrap_or_default()));
    files.sort();
    files.dedup();
    files
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[test]
    fn a_change_is_acted_on_when_it_is_quiet() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a"), folder.path().join("b"));
        std::fs::write(&a, "1").unwrap();
        let looks = Mutex::new(0);
        let files = || {
            let mut count = looks.lock().unwrap();
            *count += 1;
            match *count {
                3 => std::fs::write(&a, "22").unwrap(),
                4 => std::fs::write(&b, "333").unwrap(),
                _ => {}
            }
            vec![a.clone(), b.clone()]
        };
        let before = look(vec![a.clone(), b.clone()]);
        assert!(wait(before, files, || false));
        assert_eq!(*looks.lock().unwrap(), 5, "two quiet looks, two changes, and one look to see that they are over");
        assert!(!wait(look(vec![]), Vec::new, || true));
    }
}
