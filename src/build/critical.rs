//! Which steps are urgent: those on the longest path, by what they took before.
//!
//! A step's urgency is the length of the longest path *through* it, from an input to an output. Along the longest path
//! all steps are equally urgent, so the recipe that takes longest is begun first and then gone on with; the length from
//! the step on alone would begin all recipes before it ends any, and hold all their artefacts.
//!
//! Unaware of: threads, the order in which inputs become known.

use std::collections::BTreeMap;

use super::graph::StepId;
use super::survey::{Survey, Verdict, World};

/// What a step of an unknown kind is taken for, in milliseconds.
const UNKNOWN_MS: u64 = 100;

/// How long each step that may have to run is expected to take, in milliseconds: as long as the last time, else as long as
/// others of its kind. 0 for those that will not run.
pub(super) fn expected_ms(world: &World, survey: &Survey) -> Vec<u64> {
    let may_run = |index: usize| matches!(survey.steps[index], Verdict::Run(..) | Verdict::Maybe(_));
    let last = |index: usize| world.manifest.step(world.graph, StepId::at(index)).map(|record| record.wall_ms);
    let mut kinds: BTreeMap<&str, (u64, u64)> = BTreeMap::new();
    if (0..survey.steps.len()).any(|index| may_run(index) && last(index).is_none()) {
        for record in world.manifest.steps.rows() {
            let (sum, count) = kinds.entry(record.kind().unwrap_or("")).or_default();
            (*sum, *count) = (sum.saturating_add(record.wall_ms), *count + 1);
        }
    }
    let of_kind = |kind: &str| kinds.get(kind).map_or(UNKNOWN_MS, |(sum, count)| sum / count);
    let expected = |index: usize| match last(index) {
        _ if !may_run(index) => 0,
        // Damage must not make sums overflow.
        Some(wall_ms) => wall_ms.min(1 << 32),
        None => of_kind(world.graph.nodes[index].step.kind()).min(1 << 32),
    };
    (0..survey.steps.len()).map(expected).collect()
}

/// Length of the longest path through each step; each step of it counts a millisecond more than it is expected to take,
/// so that of short paths the one of more steps is the longer.
pub(super) fn paths(world: &World, expected_ms: &[u64]) -> Vec<u64> {
    let nodes = &world.graph.nodes;
    let own = |index: usize| expected_ms[index] + 1;
    let mut to = vec![0; nodes.len()];
    for index in 0..nodes.len() {
        let before = nodes[index].input_steps().map(|input| to[input.index()]).max().unwrap_or(0);
        to[index] = before + own(index);
    }
    let mut after = vec![0; nodes.len()];
    for index in (0..nodes.len()).rev() {
        for input in nodes[index].input_steps() {
            after[input.index()] = after[input.index()].max(after[index] + own(index));
        }
    }
    to.iter().zip(after).map(|(to, after)| to + after).collect()
}
