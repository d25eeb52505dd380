//! What each output depends on, for Make and Ninja.
//!
//! Unaware of: what is stale.

use std::path::{Path, PathBuf};

use super::graph::{Graph, Source, StepId};

/// Rules in Make's syntax, one per output of `targets` (all steps, if there are none): the output, then every input
/// file that it is made from, at any distance, then `extra` (recipes and settings, which are no inputs of steps).
///
/// Spaces, `#` and `$` are escaped as GCC does it. A path with a line break cannot be written in this syntax; its rule
/// is left out.
pub fn depfile(graph: &Graph, targets: &[StepId], extra: &[PathBuf]) -> String {
    let needed = graph.needed(targets);
    let mut text = String::new();
    for output in graph.outputs.iter().filter(|output| needed[output.step.index()]) {
        let inputs = files_below(graph, output.step);
        let paths = inputs.iter().map(|&file| &graph.files[file]).chain(extra);
        let words: Option<Vec<String>> = std::iter::once(&output.path).chain(paths).map(escaped).collect();
        if let Some((target, inputs)) = words.as_deref().and_then(|words| words.split_first()) {
            text += &format!("{target}: {}", inputs.join(" \\\n  "));
            text.push('\n');
        }
    }
    text
}

fn files_below(graph: &Graph, step: StepId) -> Vec<usize> {
    let mut files = Vec::new();
    let mut seen = vec![false; graph.nodes.len()];
    let mut stack = vec![step];
    while let Some(step) = stack.pop() {
        if std::mem::replace(&mut seen[step.index()], true) {
            continue;
        }
        for source in &graph.nodes[step.index()].inputs {
            match source {
                Source::File(file) => files.push(*file),
                Source::Step(step) => stack.push(*step),
            }
        }
    }
    files.sort_unstable();
    files.dedup();
    files
}

fn escaped(path: impl AsRef<Path>) -> Option<String> {
    let text = path.as_ref().display().to_string();
    let mut word = String::with_capacity(text.len());
    let mut backslashes = 0;
    for char in text.chars() {
        match char {
            '\n' | '\r' => return None,
            // Backslashes before an escaped character are doubled, others stay.
            ' ' | '\t' | '#' => word.extend(std::iter::repeat_n('\\', backslashes + 1)),
            '$' => word.push('$'),
            _ => {}
        }
        backslashes = if char == '\\' { backslashes + 1 } else { 0 };
        word.push(char);
    }
    Some(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_escaped_for_make() {
        let word = |path: &str| escaped(path);
        assert_eq!(word("a/b c#1$.png").as_deref(), Some("a/b\\ c\\#1$$.png"));
        assert_eq!(word("a\\b\\ c").as_deref(), Some("a\\b\\\\\\ c"));
        assert_eq!(word("a\nb"), None);
    }
}
