//! A project on disk: `kiln.toml`, the recipes, and the graph that they make together.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::build::{Graph, Options};
use crate::disk::{Disk, Real};
use crate::recipe::{self, Project, Recipe};
use crate::stage::plan::{self, Planned};

use super::args::Global;
use super::{Stop, jobs};

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
    /// The recipes as they were read; also those that could not be planned.
    pub recipes: Vec<Recipe>,
    /// Recipes that could not be planned, with the reason.
    pub broken: Vec<(String, String)>,
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
    let (project, mut recipe_files) = project(&disk)?;
    let files = if wanted.is_empty() { all(&disk)? } else { wanted.iter().map(|w| find(&disk, w)).collect() };
    let recipes = read(&disk, &files, &project)?;
    recipe_files.extend(files);
    let mut loaded = Loaded {
        graph: Graph::new(),
        planned: Vec::new(),
        recipes: Vec::new(),
        broken: Vec::new(),
        options: options(global, &project, wanted.is_empty()),
        recipe_files,
    };
    for recipe in &recipes {
        match plan::add(&mut loaded.graph, recipe, out, &disk) {
            Ok(planned) => loaded.planned.push(planned),
            Err(e) => loaded.broken.push((recipe.name.clone(), e.to_string())),
        }
    }
    loaded.recipes = recipes;
    Ok(loaded)
}

fn options(global: &Global, project: &Project, whole_tree: bool) -> Options {
    let own = Path::new(OWN);
    Options {
        jobs: jobs(global),
        keep_going: global.keep_going,
        dry_run: global.dry_run,
        whole_tree,
        cache: project.cache.path.as_ref().map_or_else(|| own.join("cache"), |p| p.path.clone()),
        manifest: own.join("manifest"),
        ..Options::default()
    }
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

/// Reads recipes; the faults of all of them are one error.
fn read(disk: &dyn Disk, files: &[PathBuf], project: &Project) -> Result<Vec<Recipe>, Stop> {
    let (mut recipes, mut faults) = (Vec::new(), Vec::new());
    for file in files {
        match disk.read(file, RECIPE_LIMIT + 1) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                let said = "there is no such recipe; expected a recipe's file, or the name of one in recipes/";
                faults.push(format!("{}: {said}", file.display()));
            }
            Err(e) => faults.push(format!("{}: {e}", file.display())),
            Ok(bytes) => match recipe::parse(file, &bytes, Some(&project.defaults)) {
                Ok(recipe) => recipes.push(recipe),
                Err(found) => faults.push(found.render(colored())),
            },
        }
    }
    let mut names: BTreeMap<&str, &Path> = BTreeMap::new();
    for recipe in &recipes {
        if let Some(first) = names.insert(&recipe.name, &recipe.path).filter(|first| *first != recipe.path) {
            let (first, second) = (first.display(), recipe.path.display());
            faults.push(format!("{first} and {second} are both called `{}`; outputs need one name each", recipe.name));
        }
    }
    if faults.is_empty() { Ok(recipes) } else { Err(Stop::Usage(faults.join("\n"))) }
}
