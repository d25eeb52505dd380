//! The map of modules in `src/lib.rs` as a test: who may name whom, and which outside crate has which door.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What each module may name. "data" is numerics, texture, mesh and uvset.
const MAY_NAME: &[(&str, &[&str])] = &[
    ("numerics", &[]),
    ("texture", &["numerics"]),
    ("mesh", &["numerics", "texture"]),
    ("uvset", &["numerics", "texture", "mesh"]),
    ("exemplar", &["data"]),
    ("field", &["data"]),
    ("synth", &["data", "exemplar", "field"]),
    ("param", &["data", "field"]),
    ("tile", &["data", "exemplar"]),
    ("bake", &["data"]),
    ("render", &["data", "bake"]),
    ("disk", &[]),
    ("io", &["data", "disk", "exemplar", "field", "synth", "tile", "bake"]),
    ("recipe", &["numerics", "texture"]),
    ("build", &["disk", "numerics"]),
    ("remote", &["build"]),
    (
        "stage",
        &["data", "exemplar", "field", "synth", "tile", "param", "bake", "render", "io", "disk", "recipe", "build"],
    ),
    ("golden", &["data", "io", "disk"]),
    (
        "cli",
        &["data", "recipe", "stage", "build", "golden", "remote", "io", "disk", "exemplar", "field", "synth", "tile"],
    ),
];

/// Outside crates and the places (path prefixes below `src`) that may name them.
const DOORS: &[(&str, &[&str])] = &[
    ("clap", &["cli"]),
    ("clap_complete", &["cli"]),
    ("signal_hook", &["cli/interrupt.rs"]),
    ("annotate_snippets", &["recipe"]),
    ("schemars", &["recipe"]),
    ("rayon", &["numerics/par.rs", "build"]),
    ("image", &["io"]),
    ("png", &["io"]),
    ("exr", &["io"]),
    ("gltf", &["io"]),
    ("uvunwrap", &["bake/unwrap"]),
    ("xatlas_rs_v2", &["bake/xatlas.rs"]),
    ("bevy_mikktspace", &["bake"]),
    ("libm", &["numerics/det.rs"]),
    ("tempfile", &["disk"]),
    ("blake3", &["build", "golden", "io/gltf"]),
    ("bazel_remote_apis", &["remote"]),
    ("prost", &["remote"]),
    ("sha2", &["remote"]),
    ("tokio", &["remote"]),
    ("tonic", &["remote"]),
];

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("src is readable") {
        let path = entry.expect("src is readable").path();
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// The code of a file without its comments and its tests (a test may look anywhere).
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).expect("a source file");
    let text = text.split("#[cfg(test)]\nmod ").next().unwrap_or("").to_string();
    text.lines().map(|l| l.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n")
}

/// Whether a file is compiled for tests only: those may look anywhere.
fn is_test(below: &str) -> bool {
    let name = below.rsplit('/').next().unwrap_or(below);
    below.contains("/tests/")
        || ["tests.rs", "testing.rs", "world.rs", "zoo.rs"].contains(&name)
        || name.ends_with("_tests.rs")
}

fn each_source(mut f: impl FnMut(&str, &str, &str)) {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&src, &mut files);
    files.sort();
    assert!(files.len() > 40, "the sources were found");
    for path in files {
        let below = path.strip_prefix(&src).expect("below src").to_string_lossy().replace('\\', "/");
        if is_test(&below) {
            continue;
        }
        let module = below.split('/').next().unwrap_or("").to_string();
        f(&module, &below, &code(&path));
    }
}

#[test]
fn modules_name_only_what_the_map_allows() {
    let table: BTreeMap<&str, &[&str]> = MAY_NAME.iter().copied().collect();
    let mut wrong = Vec::new();
    each_source(|module, file, code| {
        let Some(allowed) = table.get(module) else {
            assert!(module.ends_with(".rs"), "{module} is not in the map");
            return;
        };
        for (i, _) in code.match_indices("crate::") {
            let rest = &code[i + 7..];
            let named: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            let data = ["numerics", "texture", "mesh", "uvset"].contains(&named.as_str()) && allowed.contains(&"data");
            if table.contains_key(named.as_str()) && named != module && !data && !allowed.contains(&named.as_str()) {
                wrong.push(format!("{file} names crate::{named}"));
            }
        }
    });
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn outside_crates_have_one_door_each() {
    let mut wrong = Vec::new();
    each_source(|_, file, code| {
        for (krate, doors) in DOORS {
            for (i, _) in code.match_indices(&format!("{krate}::")) {
                let before = code[..i].chars().next_back();
                let inner = before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':');
                if !inner && !doors.iter().any(|d| file.starts_with(d)) {
                    wrong.push(format!("{file} names {krate}"));
                }
            }
        }
    });
    wrong.dedup();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn only_disk_touches_the_file_system() {
    let mut wrong = Vec::new();
    each_source(|module, file, code| {
        if module != "disk" && code.contains("std::fs") {
            wrong.push(file.to_string());
        }
    });
    assert!(wrong.is_empty(), "{wrong:#?}");
}
