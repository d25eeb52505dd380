//! A project on disk: `kiln.toml`, the recipes, and the graph that they make together.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::build::seal::{self, Look, Question, Sealed};
use crate::build::{Graph, Options};
use crate::disk::{Clock, Disk, Jobserver, Real, Stamp, machine_memory};
use crate::numerics::par;
use crate::recipe::{self, Project, Recipe};
use crate::stage::errand::Orders;
use crate::stage::plan::{self, Planned};
use crate::stage::scenes::Scenes;

use super::args::Global;
use super::marker::Marker;
use super::{Stop, farm, interrupt, jobs};

/// Where outputs go, below the project's folder.
pub(super) const OUT: &str = "out";
/// Where golden records lie.
pub(super) const GOLDEN: &str = "golden";
/// Settings of all recipes.
const SETTINGS: &str = "kiln.toml";
/// kiln's own folder.
pub(super) const OWN: &str = ".kiln";

/// Recipes are small; a larger file is a mistake.
const RECIPE_LIMIT: u64 = recipe::limits::FILE_BYTES;

/// Loaded recipes and the graph of their steps.
pub(super) struct Loaded {
    pub graph: Graph,
    pub planned: Vec<Planned>,
    /// The recipes as they were read; also those that could not be planned.
    pub recipes: Vec<Recipe>,
    /// Recipes that could not be planned, with the reason.
    pub broken: Vec<(String, String)>,
    /// Whether some recipes are wrong in themselves: they are among the broken ones.
    pub faulty: bool,
    /// What was read for planning, as it was before: recipes and settings, and files that would matter if they were
    /// there. `None` if some may change without a trace.
    pub looks: Option<Vec<Look>>,
    /// Tells others that kiln is at work here, unless nothing is to be written.
    #[expect(dead_code, reason = "it is there to be dropped")]
    marker: Option<Marker>,
    /// The cache is to have at most so many bytes.
    pub max_cache: Option<u64>,
    pub options: Options,
    /// Files that shaped the graph but are no step's input: recipes and `kiln.toml`.
    pub recipe_files: Vec<PathBuf>,
}

/// Loads the recipes named on the command line, or all of `recipes/`.
pub(super) fn load(global: &Global, wanted: &[PathBuf]) -> Result<Loaded, Stop> {
    load_into(global, wanted, Path::new(OUT))
}

/// As [`load`], with outputs below another folder.
pub(super) fn load_into(global: &Global, wanted: &[PathBuf], out: &Path) -> Result<Loaded, Stop> {
    let disk = Real;
    let own = Path::new(OWN);
    let clock = if global.dry_run { Clock::stopped(&disk) } else { Clock::new(&disk, own.join("clock")) };
    let marker = (!global.dry_run).then(|| Marker::set(&marker_file()));
    let killed = marker.as_ref().is_some_and(|marker| marker.found);
    // Now, before anything is read.
    clock.now();
    let mut looks = vec![look(&disk, Path::new(SETTINGS))];
    let (project, mut recipe_files) = project(&disk)?;
    let files = if wanted.is_empty() { all(&disk)? } else { wanted.iter().map(|w| find(&disk, w)).collect() };
    looks.extend(files.iter().map(|file| look(&disk, file)));
    let (recipes, faults) = par::install(jobs(global), || read(&disk, &files, &project));
    let said: Vec<String> = faults.iter().map(|(_, said)| said.clone()).collect();
    if !faults.is_empty() && (!global.keep_going || recipes.is_empty()) {
        return Err(Stop::Usage(said.join("\n")));
    }
    recipe_files.extend(files);
    let trusted = looks.iter().all(|look| look.1.is_none_or(|stamp| clock.trusts(&stamp)));
    let mut loaded = Loaded {
        graph: Graph::new(),
        planned: Vec::new(),
        recipes: Vec::new(),
        faulty: !faults.is_empty(),
        broken: faults,
        looks: trusted.then_some(looks),
        max_cache: project.cache.max_size,
        options: Options { clean: clock.now().filter(|_| killed), ..options(global, &project)? },
        marker,
        recipe_files,
    };
    let mut scenes = Scenes::open(&disk, &own.join("scenes"), clock);
    for recipe in &recipes {
        match plan::add(&mut loaded.graph, recipe, out, &disk, &mut scenes) {
            Ok(planned) => loaded.planned.push(planned),
            Err(e) => loaded.broken.push((recipe.name.clone(), e.to_string())),
        }
    }
    let absent = loaded.planned.iter().flat_map(|planned| &planned.absent);
    loaded.looks.iter_mut().for_each(|looks| looks.extend(absent.clone().map(|path| look(&disk, path))));
    // What is broken may have outputs, too.
    loaded.options.whole_tree = wanted.is_empty() && loaded.broken.is_empty();
    if !global.dry_run {
        // Without it the scenes are read again.
        let _ = scenes.save(&own.join("scenes"), loaded.options.whole_tree);
    }
    loaded.recipes = recipes;
    loaded.options.remote = farm::ask(global, &project.cache.remote, || {
        Orders::new(&loaded.graph, &loaded.planned, &scenes, Path::new(SETTINGS))
    })?;
    Ok(loaded)
}

/// A file as it is now. What cannot be looked at has no stamp that could be found again.
fn look(disk: &dyn Disk, path: &Path) -> Look {
    let nowhere = Stamp { len: u64::MAX, mtime_ns: i128::MIN, inode: 0 };
    (path.to_path_buf(), disk.stamp(path).unwrap_or(Some(nowhere)))
}

/// Where what a run with nothing to do looked at is kept.
fn seal_file() -> PathBuf {
    Path::new(OWN).join("seal")
}

/// What tells that a run is under way, or was killed.
fn marker_file() -> PathBuf {
    Path::new(OWN).join("running")
}

/// What `kiln bake` of all recipes is asked, apart from the files' contents; `None` if there are no recipes.
fn question(global: &Global, disk: &dyn Disk) -> Option<Question> {
    let program = std::env::current_exe().ok()?;
    let program = format!("{} {:?}", env!("CARGO_PKG_VERSION"), disk.stamp(&program).ok()??);
    let recipes = all(disk).ok()?;
    let mut parts = vec![program.as_bytes(), global.cache.as_ref().map_or(&[], |c| c.as_os_str().as_encoded_bytes())];
    parts.extend(recipes.iter().map(|recipe| recipe.as_os_str().as_encoded_bytes()));
    Some(Question::new(&parts))
}

/// Whether all recipes are known to be up to date, by the stamps of all their files; nothing is read but the seal.
pub(super) fn sealed(global: &Global) -> Option<Sealed> {
    par::install(jobs(global), || seal::check(&Real, &seal_file(), &question(global, &Real)?))
}

/// Remembers that all recipes are up to date, after a run that has made them so.
pub(super) fn seal(global: &Global, loaded: &Loaded) {
    // Without a seal, the next run takes the long way.
    let _ = match (&loaded.looks, question(global, &Real)) {
        (Some(looks), Some(question)) => {
            // A run that was killed leaves something to do.
            let looks = &[&looks[..], &[(marker_file(), None)]].concat();
            seal::seal(&loaded.graph, &loaded.options, &Real, &seal_file(), &question, looks)
        }
        _ => Real.remove(&seal_file()),
    };
}

/// How to run, but for what the recipes decide.
pub(super) fn options(global: &Global, project: &Project) -> Result<Options, Stop> {
    let own = Path::new(OWN);
    let memory = global.memory.unwrap_or_else(|| machine_memory().map_or(u64::MAX, |bytes| bytes / 4 * 3));
    // Artefacts that wait for their readers take a part of it.
    let hold_bytes = Options::default().hold_bytes.min(memory / 4);
    // Whoever says how many threads to use wants no fewer.
    let makeflags = if global.jobs.is_none() { std::env::var("MAKEFLAGS").ok() } else { None };
    let named = global.cache.clone().or_else(|| project.cache.path.as_ref().map(|p| p.path.clone()));
    Ok(Options {
        jobs: jobs(global),
        keep_going: global.keep_going,
        dry_run: global.dry_run,
        memory: memory - hold_bytes,
        hold_bytes,
        interrupt: interrupt::flag(),
        jobserver: makeflags.and_then(|flags| Jobserver::from_makeflags(&flags)).map(Arc::new),
        cache: named.unwrap_or_else(|| own.join("cache")),
        manifest: own.join("manifest"),
        ..Options::default()
    })
}

/// `kiln.toml`, if there is one.
pub(super) fn project(disk: &dyn Disk) -> Result<(Project, Vec<PathBuf>), Stop> {
    let path = Path::new(SETTINGS);
    match disk.stamp(path) {
        Ok(None) => Ok((Project::default(), Vec::new())),
        Ok(Some(_)) => {
            let bytes = disk.read(path, RECIPE_LIMIT).map_err(|e| Stop::Usage(format!("kiln.toml: {e}")))?;
            let project = recipe::parse_project(path, &bytes).map_err(|f| Stop::Usage(f.render(colored())))?;
            Ok((project, vec![path.to_path_buf()]))
        }
        Err(e) => Err(Stop::Usage(format!("kiln.toml: {e}"))),
    }
}

/// Whether messages on stderr are coloured.
fn colored() -> bool {
    !matches!(anstream::AutoStream::choice(&std::io::stderr()), anstream::ColorChoice::Never)
}

/// The recipes directly in `recipes/`, sorted.
pub(super) fn all(disk: &dyn Disk) -> Result<Vec<PathBuf>, Stop> {
    let folder = Path::new("recipes");
    let mut files = disk.list(folder).map_err(|e| Stop::Usage(format!("recipes/: {e}")))?;
    // Hidden files are editors' own.
    let hidden = |f: &PathBuf| f.file_name().is_some_and(|n| n.as_encoded_bytes().starts_with(b"."));
    files.retain(|f| f.parent() == Some(folder) && f.extension().is_some_and(|e| e == "toml") && !hidden(f));
    if files.is_empty() {
        let hint = "there are no recipes in recipes/; `kiln init MESH EXEMPLAR -o recipes/NAME.toml` starts one";
        return Err(Stop::Usage(hint.into()));
    }
    Ok(files)
}

/// A recipe's file from what was typed: the name of one in `recipes/`, or a path.
fn find(disk: &dyn Disk, typed: &Path) -> PathBuf {
    if typed.components().count() == 1 && typed.extension().is_none_or(|e| e != "toml") {
        let mut file = typed.as_os_str().to_os_string();
        file.push(".toml");
        let named = Path::new("recipes").join(file);
        if matches!(disk.stamp(&named), Ok(Some(_))) {
            return named;
        }
    }
    typed.to_path_buf()
}

/// Reads recipes, in parallel; also returns those that are wrong, by name, and what to say of them.
fn read(disk: &dyn Disk, files: &[PathBuf], project: &Project) -> (Vec<Recipe>, Vec<(String, String)>) {
    let (mut recipes, mut faults) = (Vec::<Recipe>::new(), Vec::new());
    let parsed = par::map_chunks(files.len(), 16, |range| {
        let parse = |file: &PathBuf| {
            let bytes = disk.read(file, RECIPE_LIMIT + 1)?;
            Ok(recipe::parse(file, &bytes, Some(&project.defaults)))
        };
        files[range].iter().map(parse).collect::<Vec<std::io::Result<_>>>()
    });
    for (file, parsed) in files.iter().zip(parsed.into_iter().flatten()) {
        let name = file.file_stem().unwrap_or_default().to_string_lossy();
        let mut fault = |said: String| faults.push((name.to_string(), said));
        match parsed {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                let said = "there is no such recipe; expected a recipe's file, or the name of one in recipes/";
                fault(format!("{}: {said}", file.display()));
            }
            Err(e) => fault(format!("{}: {e}", file.display())),
            Ok(Ok(recipe)) => recipes.push(recipe),
            Ok(Err(found)) => fault(found.render(colored())),
        }
    }
    let mut names: BTreeMap<&str, &Path> = BTreeMap::new();
    for recipe in &recipes {
        if let Some(first) = names.insert(&recipe.name, &recipe.path).filter(|first| *first != recipe.path) {
            let (first, second) = (first.display(), recipe.path.display());
            let said = format!("{first} and {second} are both called `{}`; outputs need one name each", recipe.name);
            faults.push((recipe.name.clone(), said));
        }
    }
    // Neither of two of one name is baked.
    recipes.retain(|recipe| faults.iter().all(|(name, _)| *name != recipe.name));
    (recipes, faults)
}
