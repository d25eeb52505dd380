//! Whatever is in the file, there is a recipe or a fault.

use super::{FULL, LEAST};
use crate::recipe::{parse, parse_project};
use proptest::prelude::*;
use std::path::Path;

/// Words and signs that mean something somewhere.
const BITS: [&str; 24] = [
    "[",
    "]",
    "[[",
    "{",
    "}",
    "=",
    ",",
    "\n",
    "\"",
    "'",
    ".",
    "-",
    "0",
    "1e999",
    "nan",
    "true",
    "\"auto\"",
    "[]",
    "{}",
    "mesh",
    "canvas",
    "size",
    "1979-05-27",
    "\u{301}",
];

/// Reads and shows: every fault lies in the file and says something.
fn survives(bytes: &[u8]) {
    let project = parse_project(Path::new("kiln.toml"), bytes);
    let defaults = project.as_ref().ok().map(|project| &project.defaults);
    for result in [parse(Path::new("r.toml"), bytes, None), parse(Path::new("r.toml"), LEAST.as_bytes(), defaults)] {
        if let Err(faults) = result {
            assert!(faults.count() > 0);
            let lines = faults.iter().count() + usize::from(faults.count() > faults.iter().count());
            assert_eq!(faults.to_string().lines().count(), lines);
            assert!(faults.render(false).starts_with("error: "));
            for fault in faults.iter().filter(|fault| fault.file == "r.toml") {
                assert!(fault.line <= bytes.iter().filter(|&&b| b == b'\n').count() + 1);
                assert!(fault.span.end <= bytes.len());
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        survives(&bytes);
    }

    #[test]
    fn bits_of_recipes_never_panic(bits in prop::collection::vec(prop::sample::select(&BITS[..]), 0..40)) {
        survives(bits.join(" ").as_bytes());
        survives(bits.concat().as_bytes());
    }

    #[test]
    fn altered_recipes_never_panic(edits in prop::collection::vec((any::<prop::sample::Index>(), 0..12usize,
        prop::sample::select(&BITS[..])), 1..6), under in any::<bool>()) {
        let mut text: Vec<char> = FULL.chars().collect();
        for (at, cut, put) in edits {
            let start = at.index(text.len() + 1);
            let end = (start + cut).min(text.len());
            text.splice(start..end, put.chars());
        }
        let text: String = text.into_iter().collect();
        survives(text.as_bytes());
        if under {
            survives(text.replace("\n[", "\n[defaults.").replace("[defaults.[", "[[defaults.").as_bytes());
        }
    }

    #[test]
    fn lines_in_any_order_never_panic(order in prop::collection::vec(0..62usize, 0..70)) {
        let lines: Vec<&str> = FULL.lines().collect();
        let text: Vec<&str> = order.iter().filter_map(|&i| lines.get(i).copied()).collect();
        survives(text.join("\n").as_bytes());
    }
}
