//! Why a step runs, in words, by comparing what its key is made of with what it was made of.
//!
//! Unaware of: hashing; it reads the same description that was hashed.

use std::collections::BTreeMap;

use super::digest::Digest;
use super::graph::{Source, StepId};
use super::manifest::{Detail, tagged_label};
use super::survey::{Seen, World};

/// The step is as it was, but what it gave is gone.
pub(super) const LOST: &str = "artefact missing from cache";

/// Values longer than this are shown around their first difference.
const SHOWN_CHARS: usize = 60;

/// Why a step with these inputs runs; at least one reason.
pub(super) fn reasons(world: &World, step: StepId, inputs: &[Digest]) -> Vec<String> {
    let found = differences(world, step, |input| Some(inputs[input]));
    if found.is_empty() { vec![LOST.to_string()] } else { found }
}

/// All differences from the last time, among the inputs only where `digest_of` knows them; empty if there are none.
pub(super) fn differences(world: &World, step: StepId, digest_of: impl Fn(usize) -> Option<Digest>) -> Vec<String> {
    let node = &world.graph.nodes[step.index()];
    let Some(before) = world.manifest.step(world.graph, step).and_then(|record| record.detail()) else {
        return vec!["never built".to_string()];
    };
    let mut found = Vec::new();
    if before.kind != node.step.kind() {
        found.push(format!("step kind {} -> {}", before.kind, node.step.kind()));
    } else if before.revision != node.step.revision() {
        found.push(format!("step revision {} -> {}", before.revision, node.step.revision()));
    }
    compare_params(&before, &node.params, &mut found);
    compare_inputs(world, &before, &node.inputs, digest_of, &mut found);
    found
}

/// Why an output file has to be written.
pub(super) fn output(world: &World, output: usize, seen: &Seen) -> String {
    let path = world.graph.outputs[output].path.display();
    match seen {
        Seen::Known { .. } => format!("output {path}: content differs"),
        Seen::Faulty(why) => format!("output {path} cannot be read: {why}"),
        Seen::Missing | Seen::Ignored => format!("output {path} missing"),
    }
}

/// Pairs a parameter with the one that had its name before; of several of one name, the first with the first.
fn compare_params(before: &Detail, now: &[(String, String)], found: &mut Vec<String>) {
    let mut old = BTreeMap::new();
    let mut counts = BTreeMap::new();
    for &(name, value) in &before.params {
        let nth = counts.entry(name).and_modify(|n| *n += 1).or_insert(0usize);
        old.insert((name, *nth), value);
    }
    counts.clear();
    let mut same_place = before.params.len() == now.len();
    for (index, (name, value)) in now.iter().enumerate() {
        let nth = counts.entry(name.as_str()).and_modify(|n| *n += 1).or_insert(0usize);
        same_place &= before.params.get(index).is_some_and(|param| param.0 == name);
        match old.remove(&(name.as_str(), *nth)) {
            Some(was) if was == value => {}
            Some(was) => {
                let (was, is) = shorten(was, value);
                found.push(format!("`{name}` changed from {was} to {is}"));
            }
            None => found.push(format!("`{name}` is new: {}", shorten(value, value).0)),
        }
    }
    for ((name, _), was) in old {
        found.push(format!("`{name}` is gone, was {}", shorten(was, was).0));
    }
    if found.is_empty() && !same_place {
        found.push("order of parameters changed".to_string());
    }
}

fn compare_inputs(
    world: &World,
    before: &Detail,
    now: &[Source],
    digest_of: impl Fn(usize) -> Option<Digest>,
    found: &mut Vec<String>,
) {
    let mut old: BTreeMap<&[u8], Digest> = before.inputs.iter().copied().collect();
    let labels: Vec<Vec<u8>> = now.iter().map(|source| tagged_label(world.graph, *source)).collect();
    let mut changed = false;
    for (index, (source, tagged)) in now.iter().zip(&labels).enumerate() {
        let label = world.graph.label(*source);
        match (before.inputs.iter().find(|input| input.0 == tagged.as_slice()), digest_of(index)) {
            (None, _) => found.push(format!("{label}: new input")),
            (Some((_, was)), Some(is)) if *was != is => match source {
                Source::File(_) => found.push(format!("{label}: content changed")),
                Source::Step(_) => found.push(format!("`{label}` gave another artefact")),
            },
            _ => continue,
        }
        changed = true;
    }
    for label in &labels {
        old.remove(label.as_slice());
    }
    for label in old.keys() {
        changed = true;
        found.push(format!("{}: no longer an input", String::from_utf8_lossy(&label[1..])));
    }
    let same_order = before.inputs.iter().map(|input| input.0).eq(labels.iter().map(Vec::as_slice));
    if !changed && !same_order {
        found.push("order of inputs changed".to_string());
    }
}

/// Two long values, cut to where they differ first.
fn shorten(a: &str, b: &str) -> (String, String) {
    let same = a.chars().zip(b.chars()).take_while(|(a, b)| a == b).count();
    let same = if a == b { 0 } else { same };
    let cut = |text: &str| {
        let count = text.chars().count();
        if count <= SHOWN_CHARS {
            return text.to_string();
        }
        let start = same.saturating_sub(SHOWN_CHARS / 3).min(count - SHOWN_CHARS);
        let middle: String = text.chars().skip(start).take(SHOWN_CHARS).collect();
        let (head, tail) = (start > 0, start + SHOWN_CHARS < count);
        format!("{}{middle}{}", if head { "..." } else { "" }, if tail { "..." } else { "" })
    };
    (cut(a), cut(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_values_stay_and_long_ones_show_the_difference() {
        assert_eq!(shorten("[5, 3]", "[9, 5, 3]"), ("[5, 3]".to_string(), "[9, 5, 3]".to_string()));
        let long = "x".repeat(500);
        let other = format!("{}y{}", "x".repeat(300), "x".repeat(199));
        let (was, is) = shorten(&long, &other);
        assert!(is.contains('y') && !was.contains('y') && is.len() < 80, "{is}");
    }
}
