//! A project on disk: `kiln.toml`, the recipes, and the graph that they make together.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::build::{Graph, Options};
use crate::disk::{Disk, Jobserver, Real, machine_memory};
use crate::recipe::{self, Project, Recipe};
use crate::stage::plan::{self, Planned};

use super::args::Global;
use super::{Stop, interrupt, jobs};

/// Where outputs go, below the project's folder.
pub(super) const OUT: &str = "out";
/// Where golden records lie.
pub(super) const GOLDEN: &str = "golden";
/// kiln's own folder.
pub(super) const OWN: &str = ".kiln";

/// Recipes are small; a larger file is a mistake.
const RECIPE_LIMIT: u64 = recipe::limits::FILE_BYTES;

/// Loaded recipes and the graph of their steps.
pub(super) struct Loaded {
    pub graph: Graph,
    pub planned: Vec<Planned>,
    /// Recipes that could not be planned, with the reason.
    pub broken: Vec<(String, String)>,
    /// Whether some recipes are wrong in themselves: they are among the broken ones.
    pub faulty: bool,
    /// The cache is to have at most so many bytes.
    pub max_cache: Option<u64>,
    pub options: Options,
    /// Files that shaped the graph but are no step's input: recipes and `kiln.toml`.
    pub recipe_files: Vec<PathBuf>,
}

/// Loads the recipes named on the command line, or all of `recipes/`.
pub(super) fn load(global: &Global, wanted: &[PathBuf]) -> Result<Loaded, Stop> {
    let disk = Real;
    let (project, mut recipe_files) = project(&disk)?;
    let files = if wanted.is_empty() { all(&disk)? } else { wanted.iter().map(|w| find(&disk, w)).collect() };
    let (recipes, faults) = read(&disk, &files, &project);
    let said: Vec<String> = faults.iter().map(|(_, said)| said.clone()).collect();
    if !faults.is_empty() && (!global.keep_going || recipes.is_empty()) {
        return Err(Stop::Usage(said.join("\n")));
    }
    recipe_files.extend(files);
    let mut loaded = Loaded {
        graph: Graph::new(),
        planned: Vec::new(),
        faulty: !faults.is_empty(),
        broken: faults,
        max_cache: project.cache.max_size,
        options: options(global, &project)?,
        recipe_files,
    };
    for recipe in &recipes {
        match plan::add(&mut loaded.graph, recipe, Path::new(OUT), &disk) {
            Ok(planned) => loaded.planned.push(planned),
            Err(e) => loaded.broken.push((recipe.name.clone(), e.to_string())),
        }
    }
    // What is broken may have outputs, too.
    loaded.options.whole_tree = wanted.is_empty() && loaded.broken.is_empty();
    Ok(loaded)
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
    let path = Path::new("kiln.toml");
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
fn all(disk: &dyn Disk) -> Result<Vec<PathBuf>, Stop> {
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

/// Reads recipes; also returns those that are wrong, by name, and what to say of them.
fn read(disk: &dyn Disk, files: &[PathBuf], project: &Project) -> (Vec<Recipe>, Vec<(String, String)>) {
    let (mut recipes, mut faults) = (Vec::<Recipe>::new(), Vec::new());
    for file in files {
        let name = file.file_stem().unwrap_or_default().to_string_lossy();
        let mut fault = |said: String| faults.push((name.to_string(), said));
        match disk.read(file, RECIPE_LIMIT + 1) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                let said = "there is no such recipe; expected a recipe's file, or the name of one in recipes/";
                fault(format!("{}: {said}", file.display()));
            }
            Err(e) => fault(format!("{}: {e}", file.display())),
            Ok(bytes) => match recipe::parse(file, &bytes, Some(&project.defaults)) {
                Ok(recipe) => recipes.push(recipe),
                Err(found) => fault(found.render(colored())),
            },
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
