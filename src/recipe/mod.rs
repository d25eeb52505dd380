//! Recipes: from TOML to plain values, or to every fault that stands between them.
//!
//! ```text
//!   text --tree--> keys and values with places --shape--> the same, without what is wrong
//!                                  ^ defaults of kiln.toml       |
//!                                                             rules: what goes with what
//!   Recipe <--validate-- schema (serde) <------------------------'
//! ```
//!
//! A fault does not stop the reading: what is wrong is reported and taken out, and the rest is checked as if it had
//! not been written. So a recipe with three mistakes reports three.
//! Unaware of: the file system. Files are named here, never opened.

mod fault;
mod frame_pattern;
mod hint;
mod json_schema;
pub mod limits;
mod project;
mod rules;
mod samples;
mod schema;
mod shape;
mod template;
mod tree;
mod validate;
mod values;
mod words;

pub use fault::{Fault, Faults};
pub use frame_pattern::{FrameError, FramePattern};
pub use json_schema::json_schema;
pub use project::is_address;
pub use template::{Starter, guess_map, is_feature_mask, template};
pub use values::*;
pub use words::*;

use fault::{Findings, Source};
use serde::de::DeserializeOwned;
use shape::Whole;
use std::path::Path;
use tree::{At, Node, Table, Value};

/// Tables merged under each recipe, from `kiln.toml`; empty by default.
#[derive(Clone, Debug, Default)]
pub struct Defaults {
    table: Table,
    source: Option<Source>,
}

/// Reads a recipe.
///
/// `path` is the recipe's file as the user knows it: its stem names the recipe, its folder is what relative paths
/// are relative to, and messages repeat it. Defaults lie under the recipe's tables key by key; arrays are replaced
/// whole, and a default gives way to a key of the recipe that excludes it. Errors: every fault of the recipe.
pub fn parse(path: &Path, bytes: &[u8], defaults: Option<&Defaults>) -> Result<Recipe, Faults> {
    let mut findings = Findings::default();
    let name = validate::name(path).unwrap_or_else(|message| {
        findings.push(Fault::new(At { source: 0, span: 0..0 }, "", message));
        String::new()
    });
    let (mut tree, mut sources, whole) = read(path, bytes, &mut findings);
    if let Some(Defaults { table, source: Some(source) }) = defaults {
        sources.push(source.clone());
        tree.merge_under(&rules::without_rivals(&tree, table));
    }
    shape::check(&mut tree, &json_schema::RECIPE, whole, &mut findings);
    rules::check_presence(&tree, &mut findings);
    if whole == Whole::Required {
        rules::check_absence(&tree, &mut findings);
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let recipe = deserialise(&tree, &mut findings).map(|from| {
        let mut context = validate::Context { tree: &tree, sources: &sources, folder, findings: &mut findings };
        validate::recipe(name, path.into(), from, &mut context)
    });
    match recipe {
        Some(recipe) if findings.is_empty() => Ok(recipe),
        _ => Err(findings.finish(sources)),
    }
}

/// Reads `kiln.toml`. `path` as the user knows it; the cache's folder is relative to its folder. Errors: every fault
/// of the file that does not depend on a recipe.
pub fn parse_project(path: &Path, bytes: &[u8]) -> Result<Project, Faults> {
    let mut findings = Findings::default();
    let (mut tree, sources, _) = read(path, bytes, &mut findings);
    shape::check(&mut tree, &json_schema::PROJECT, Whole::Partial, &mut findings);
    let mut table = match tree.entry("defaults").map(|entry| entry.node.value.clone()) {
        Some(Value::Table(table)) => table,
        _ => Table::new(),
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let cache = deserialise(&tree, &mut findings).map(|from: schema::Project| {
        let mut context = validate::Context { tree: &tree, sources: &sources, folder, findings: &mut findings };
        project::cache(from.cache, &mut context)
    });
    match cache {
        Some(cache) if findings.is_empty() => {
            tree::renumber(&mut table, DEFAULTS_SOURCE);
            Ok(Project { defaults: Defaults { table, source: sources.into_iter().next() }, cache })
        }
        _ => Err(findings.finish(sources)),
    }
}

/// The recipe is source 0, `kiln.toml` source 1.
const DEFAULTS_SOURCE: usize = 1;

/// Reads a file's bytes as far as they are TOML. What is broken may have held what would be missed: then the tree is
/// partial.
fn read(path: &Path, bytes: &[u8], findings: &mut Findings) -> (Node, Vec<Source>, Whole) {
    let at = |byte: usize| At { source: 0, span: byte..byte };
    let mut whole = Whole::Required;
    let text = if bytes.len() as u64 > limits::FILE_BYTES {
        let message = format!("the file has {} bytes, too many for a recipe", bytes.len());
        findings.push(Fault::new(at(0), "", message).allowed(format!("at most {} bytes", limits::FILE_BYTES)));
        whole = Whole::Partial;
        ""
    } else {
        std::str::from_utf8(bytes).unwrap_or_else(|e| {
            let good = &bytes[..e.valid_up_to()];
            let message = format!("the file is not UTF-8 text: it has a byte 0x{:02x} here", bytes[good.len()]);
            findings.push(Fault::new(at(good.len()), "", message).hint("save it as UTF-8".to_string()));
            whole = Whole::Partial;
            std::str::from_utf8(good).unwrap_or_default()
        })
    };
    let (tree, errors) = tree::read(0, text);
    for error in errors {
        whole = Whole::Partial;
        findings.push(Fault::syntax(error.at, &error.message));
    }
    (tree, vec![Source { name: path.display().to_string(), text: text.into() }], whole)
}

/// The values of a tree whose shape was checked. What serde still refuses, after faults, is their consequence.
fn deserialise<T: DeserializeOwned>(tree: &Node, findings: &mut Findings) -> Option<T> {
    match tree.to_toml().try_into() {
        Ok(value) => Some(value),
        Err(e) => {
            let e: toml::de::Error = e;
            if findings.is_empty() {
                debug_assert!(false, "serde refuses what the schema allows: {e}");
                findings.push(Fault::new(tree.at.clone(), "", e.message().to_string()));
            }
            None
        }
    }
}

#[cfg(test)]
mod tests;
