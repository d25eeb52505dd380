//! A step that is done on another machine: what has to go with its inputs, and doing it there.
//!
//! A step is a function of its inputs' bytes and its parameters, and the parameters follow from the recipe. So the recipe
//! goes along, with the names of the files that planning looked for; their contents do not. The other machine plans the
//! recipe anew and takes the step whose key is the one that was asked for: another kiln, whose steps are others, finds
//! none, and says so.
//!
//! Unaware of: how it gets there.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::build::{Bytes, Digest, Graph, StepError, StepId, run_step};
use crate::disk::{Clock, Disk, Memory};
use crate::recipe;

use super::plan::{self, Planned};
use super::scenes::Scenes;

/// Raised when orders are read in another way.
const VERSION: u32 = 1;

/// What another machine has to know to do the steps of one recipe.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Order {
    version: u32,
    /// The recipe's file.
    recipe: String,
    text: String,
    /// What `kiln.toml` holds.
    settings: Option<String>,
    /// Files that are there.
    files: Vec<String>,
    /// What scenes among them refer to.
    scenes: BTreeMap<String, Vec<String>>,
}

/// The orders of all recipes.
#[derive(Clone, Debug)]
pub struct Orders {
    recipes: Vec<Source>,
    /// A recipe of each step.
    of: BTreeMap<StepId, usize>,
    scenes: BTreeMap<PathBuf, Vec<String>>,
    settings: PathBuf,
}

#[derive(Clone, Debug)]
struct Source {
    recipe: PathBuf,
    files: Vec<PathBuf>,
}

impl Orders {
    /// From what was planned; `settings` is the file that may hold defaults.
    pub fn new(graph: &Graph, planned: &[Planned], scenes: &Scenes, settings: &Path) -> Self {
        let mut of = BTreeMap::new();
        let mut recipes = Vec::new();
        for (index, planned) in planned.iter().enumerate() {
            planned.steps.iter().for_each(|step| _ = of.entry(*step).or_insert(index));
            let files = graph.files_of(&planned.steps).map(Path::to_path_buf).collect();
            recipes.push(Source { recipe: planned.recipe.clone(), files });
        }
        Orders { recipes, of, scenes: scenes.asked(), settings: settings.to_path_buf() }
    }

    /// What has to go with the inputs of `step`; `None` if it cannot be said.
    pub fn order(&self, disk: &dyn Disk, step: StepId) -> Option<Vec<u8>> {
        let Source { recipe, files } = &self.recipes[*self.of.get(&step)?];
        let read = |path: &Path| String::from_utf8(disk.read(path, recipe::limits::FILE_BYTES).ok()?).ok();
        let name = |path: &PathBuf| path.to_str().map(str::to_string);
        let scenes = files.iter().filter_map(|file| Some((name(file)?, self.scenes.get(file)?.clone())));
        let order = Order {
            version: VERSION,
            recipe: name(recipe)?,
            text: read(recipe)?,
            settings: read(&self.settings),
            files: files.iter().map(name).collect::<Option<_>>()?,
            scenes: scenes.collect(),
        };
        serde_json::to_vec(&order).ok()
    }
}

/// Does the step of this key.
pub fn carry_out(order: &[u8], key: &Digest, inputs: Vec<Bytes>) -> Result<Vec<u8>, StepError> {
    let order: Order = serde_json::from_slice(order).map_err(|e| format!("the order cannot be read: {e}"))?;
    if order.version != VERSION {
        return Err(format!("the order is of version {}, expected {VERSION}", order.version).into());
    }
    let disk = Memory::new();
    for file in &order.files {
        disk.write(Path::new(file), b"").map_err(|e| format!("{file}: {e}"))?;
    }
    let defaults = match &order.settings {
        Some(text) => recipe::parse_project(Path::new("kiln.toml"), text.as_bytes())?.defaults,
        None => recipe::Defaults::default(),
    };
    let recipe = recipe::parse(Path::new(&order.recipe), order.text.as_bytes(), Some(&defaults))?;
    let scenes = order.scenes.into_iter().map(|(scene, files)| (PathBuf::from(scene), files));
    let mut scenes = Scenes::known(&disk, Clock::stopped(&disk), scenes);
    let mut graph = Graph::new();
    plan::add(&mut graph, &recipe, Path::new("out"), &disk, &mut scenes)?;
    run_step(&graph, key, inputs).ok_or("the recipe has no such step: another version of kiln?")?
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{Options, Silent, run};

    const RECIPE: &str = "[canvas]\nsize = [24, 16]\n[exemplar]\nbase_color = 'e.png'\n[synthesis]\nrefine = 0\n";

    /// A small picture.
    fn picture() -> Vec<u8> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, 8, 8);
        encoder.set_color(png::ColorType::Rgb);
        let data: Vec<u8> = (0..192u32).map(|i| (i * i * 7) as u8).collect();
        encoder.write_header().and_then(|mut w| w.write_image_data(&data)).unwrap();
        out
    }

    #[test]
    fn a_step_comes_out_the_same_from_its_order() {
        let disk = Memory::new();
        disk.write(Path::new("recipes/r.toml"), RECIPE.as_bytes()).unwrap();
        disk.write(Path::new("recipes/e.png"), &picture()).unwrap();
        let settings = "[defaults.analysis]\nneighbourhoods = [3]\n";
        disk.write(Path::new("kiln.toml"), settings.as_bytes()).unwrap();
        let defaults = recipe::parse_project(Path::new("kiln.toml"), settings.as_bytes()).unwrap().defaults;
        let recipe = recipe::parse(Path::new("recipes/r.toml"), RECIPE.as_bytes(), Some(&defaults)).unwrap();
        let (mut graph, mut scenes) = (Graph::new(), Scenes::known(&disk, Clock::stopped(&disk), []));
        let planned = plan::add(&mut graph, &recipe, Path::new("out"), &disk, &mut scenes).unwrap();
        let orders = Orders::new(&graph, std::slice::from_ref(&planned), &scenes, Path::new("kiln.toml"));
        let report = run(&graph, &[], &Options::default(), &disk, &Silent).unwrap();
        let (step, maps) = (planned.steps[1], &report.steps[0]);
        assert_eq!((graph.name(step), maps.name.as_str()), ("r/analyse", "r/maps"));

        let artefact = |of: &crate::build::StepReport| {
            let cache = crate::build::Cache::new(&disk, ".kiln/cache");
            cache.load(&of.artefact.unwrap(), of.len).unwrap()
        };
        let input = Bytes::from(artefact(maps));
        let key = graph.step_key(step, std::slice::from_ref(&input));
        let order = orders.order(&disk, step).unwrap();
        let there = carry_out(&order, &key, vec![input.clone()]).unwrap();
        assert_eq!(Some(Digest::of(&there)), report.steps[1].artefact);

        let wrong = carry_out(&order, &Digest::of(b"?"), vec![input.clone()]).unwrap_err();
        assert!(wrong.to_string().contains("no such step"), "{wrong}");
        assert!(carry_out(b"{}", &key, vec![input]).is_err());
    }
}
