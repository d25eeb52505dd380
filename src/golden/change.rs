//! Which step of a recipe went another way than when it was accepted, and what moved it.
//!
//! In: the book as accepted and as it would be now. Out: the first step, in the order of the graph, whose artefact is
//! another one, and in words what of its revision, parameters and input files is not as accepted.
//! Unaware of: the engine's own explanations, which go by what was on this machine before.

use super::book::{Book, Step};
use std::collections::BTreeMap;

/// The first step that went another way, and what moved it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// The step's name.
    pub step: String,
    /// What of it is not as accepted, in words; empty if the book does not tell.
    pub reasons: Vec<String>,
    /// Everything that its artefact may depend on is as accepted, and the artefact is not.
    pub is_unexplained: bool,
}

/// The first step, in the order of the graph, whose artefact is not the accepted one or that was not there.
pub fn first_change(expected: &Book, actual: &Book) -> Option<Change> {
    let differs = |s: &&Step| expected.step(&s.name).is_none_or(|old| old.artefact != s.artefact);
    let now = actual.steps.iter().find(differs)?;
    let change = |reasons, is_unexplained| Some(Change { step: now.name.clone(), reasons, is_unexplained });
    let Some(old) = expected.step(&now.name) else {
        return change(vec!["there was no such step".into()], false);
    };
    let (Some(was), Some(is)) = (old.revision, now.revision) else {
        return change(Vec::new(), false);
    };
    let mut reasons = Vec::new();
    if was != is {
        reasons.push(format!("step revision {was} -> {is}"));
    }
    for (key, was, is) in moved(&old.params, &now.params) {
        reasons.push(match (was, is) {
            (Some(was), Some(is)) => format!("`{key}` changed from {was} to {is}"),
            (None, is) => format!("`{key}` is new: {}", is.unwrap_or_default()),
            (was, None) => format!("`{key}` is gone, was {}", was.unwrap_or_default()),
        });
    }
    for (path, was, is) in moved(&old.files, &now.files) {
        reasons.push(match (was, is) {
            (Some(_), Some(_)) => format!("{path}: content changed"),
            (None, _) => format!("{path}: new input"),
            (_, None) => format!("{path}: no longer an input"),
        });
    }
    // Those before it gave what was accepted; but one may have gone, or its place have been taken.
    let gone = expected.steps.iter().filter(|s| actual.step(&s.name).is_none());
    reasons.extend(gone.map(|s| format!("step `{}` is gone", s.name)));
    if !reasons.is_empty() {
        return change(reasons, false);
    }
    let said = "its revision, parameters and inputs are as accepted: the code behind it changed, and its revision was not \
                raised";
    change(vec![said.into()], true)
}

type Moved<'a> = (&'a str, Option<&'a str>, Option<&'a str>);

/// The keys whose values are not the same in both.
fn moved<'a>(old: &'a BTreeMap<String, String>, new: &'a BTreeMap<String, String>) -> Vec<Moved<'a>> {
    let mut keys: Vec<&str> = old.keys().chain(new.keys()).map(String::as_str).collect();
    keys.sort_unstable();
    keys.dedup();
    let both = keys.into_iter().map(|k| (k, old.get(k).map(String::as_str), new.get(k).map(String::as_str)));
    both.filter(|(_, was, is)| was != is).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digest(c: char) -> String {
        c.to_string().repeat(64)
    }

    fn step(name: &str, c: char) -> Step {
        Step { name: name.into(), artefact: digest(c), ..Step::default() }
    }

    #[test]
    fn the_first_step_that_went_another_way_is_named() {
        let old = Book::new(vec![], vec![step("decode", 'a'), step("analyse", 'b'), step("walk", 'c')]);
        let now = Book::new(vec![], vec![step("decode", 'a'), step("analyse", 'e'), step("walk", 'f')]);
        let change = first_change(&old, &now).unwrap();
        assert_eq!((change.step.as_str(), change.is_unexplained), ("analyse", false));
        assert!(change.reasons.is_empty(), "an older book does not tell");
        assert_eq!(first_change(&old, &old), None);
    }

    #[test]
    fn what_moved_the_first_step_is_told() {
        let full = |c, revision, jumps: &str, file| Step {
            revision: Some(revision),
            params: [("jumps".to_string(), jumps.to_string()), ("wrap".into(), "Clamp".into())].into(),
            files: [("moss.png".to_string(), digest(file))].into(),
            ..step("analyse", c)
        };
        let old = Book::new(vec![], vec![step("decode", 'a'), full('b', 3, "3", 'f')]);
        let change = |s: Step| first_change(&old, &Book::new(vec![], vec![step("decode", 'a'), s])).unwrap();
        let reasons = change(full('c', 4, "5", 'e')).reasons;
        let expected = ["step revision 3 -> 4", "`jumps` changed from 3 to 5", "moss.png: content changed"];
        assert_eq!(reasons, expected);
        let mut other = full('c', 3, "3", 'f');
        other.params.remove("wrap");
        other.params.insert("tile".into(), "true".into());
        assert_eq!(change(other).reasons, ["`tile` is new: true", "`wrap` is gone, was Clamp"]);
        // The same step, another artefact: nobody raised the revision.
        let forgotten = change(full('c', 3, "3", 'f'));
        assert!(forgotten.is_unexplained && forgotten.reasons[0].contains("revision was not raised"));
        assert!(!change(full('c', 4, "3", 'f')).is_unexplained);
        let without = Book::new(vec![], vec![full('c', 3, "3", 'f')]);
        assert_eq!(first_change(&old, &without).unwrap().reasons, ["step `decode` is gone"]);
        assert_eq!(first_change(&without, &old).unwrap().reasons, ["there was no such step"]);
    }
}
