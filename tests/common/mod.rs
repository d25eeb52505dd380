//! Shared by the tests of the program: a fresh folder, the real binary, the data that may be beside the project.
#![allow(dead_code)] // Each test program uses its part of this.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A fresh project folder, removed at the end.
pub struct Project(tempfile::TempDir);

/// What a run of kiln came to.
pub struct Ran {
    pub code: i32,
    pub out: String,
    pub err: String,
}

pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The development data, where it is there; says so where it is not.
pub fn shared(below: &str) -> Option<PathBuf> {
    let path = root().join("../shared/data").join(below);
    if !path.exists() {
        println!("skipped: {below} of the development data is not here");
        return None;
    }
    Some(path.canonicalize().expect("a path that exists"))
}

impl Project {
    pub fn new() -> Self {
        Project(tempfile::tempdir().expect("a temporary folder"))
    }

    /// A project with a copy of the committed recipes, their assets and the golden records.
    pub fn with_recipes() -> Self {
        let project = Project::new();
        copy(&root().join("recipes"), &project.path("recipes"));
        copy(&root().join("golden"), &project.path("golden"));
        project
    }

    pub fn path(&self, below: &str) -> PathBuf {
        self.0.path().join(below)
    }

    pub fn write(&self, below: &str, bytes: impl AsRef<[u8]>) {
        let path = self.path(below);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, bytes).expect("a file");
    }

    pub fn read(&self, below: &str) -> Vec<u8> {
        std::fs::read(self.path(below)).unwrap_or_else(|e| panic!("{below}: {e}"))
    }

    pub fn kiln(&self, args: &[&str]) -> Ran {
        self.kiln_with(args, &[])
    }

    pub fn kiln_with(&self, args: &[&str], env: &[(&str, &str)]) -> Ran {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kiln"));
        command.arg("-C").arg(self.0.path()).args(args).env_remove("CI").env_remove("MAKEFLAGS").env("NO_COLOR", "1");
        command.envs(env.iter().copied());
        let Output { status, stdout, stderr } = command.output().expect("kiln runs");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("kiln prints UTF-8");
        Ran { code: status.code().unwrap_or(-1), out: text(stdout), err: text(stderr) }
    }

    /// Starts kiln and does not wait for it.
    pub fn start(&self, args: &[&str]) -> std::process::Child {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kiln"));
        command.arg("-C").arg(self.0.path()).args(args).env_remove("CI").env_remove("MAKEFLAGS");
        command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
        command.spawn().expect("kiln starts")
    }

    /// All files below a folder with their bytes.
    pub fn contents(&self, below: &str) -> std::collections::BTreeMap<String, Vec<u8>> {
        self.files(below).into_iter().map(|file| (file.clone(), self.read(&file))).collect()
    }

    /// Files below a folder, relative to the project, sorted.
    pub fn files(&self, below: &str) -> Vec<String> {
        let mut found = Vec::new();
        list(&self.path(below), &mut found);
        let mut names: Vec<String> = found
            .iter()
            .map(|p| p.strip_prefix(self.0.path()).expect("below").to_string_lossy().replace('\\', "/"))
            .collect();
        names.sort();
        names
    }
}

impl Ran {
    /// The run, if it ended with `code`; else everything it said, in a panic.
    pub fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, code, "stdout:\n{}\nstderr:\n{}", self.out, self.err);
        self
    }
}

/// A recipe of every kind of step that is quick: a tetrahedron with an atlas, UV sets and a view.
pub const MESH_RECIPE: &str = r#"
[mesh]
path = "m.obj"
[exemplar]
base_color = "e.png"
[analysis]
neighbourhoods = [3]
[synthesis]
scale = 12.0
refine = 0
[atlas]
size = 32
[uv_sets]
[[render]]
view = "turntable-1"
size = 32
"#;

/// A flat texture.
pub const CANVAS_RECIPE: &str = "[canvas]\nsize = [96, 64]\n[exemplar]\nbase_color = 'e.png'\n[analysis]\nneighbourhoods = [3]\n[synthesis]\nrefine = 0\n";

/// A tetrahedron.
pub const TETRAHEDRON: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

/// A picture with something in it; pictures of one size have one length, whatever the phase.
pub fn picture(side: u32, phase: u32) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, side, side);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::NoCompression);
    let texel = |i: u32| [(i * 37 + phase) as u8, (i * i * 11) as u8, (i / side * 15) as u8];
    let data: Vec<u8> = (0..side * side).flat_map(texel).collect();
    encoder.write_header().and_then(|mut w| w.write_image_data(&data)).expect("a picture in memory");
    out
}

/// A project of `count` recipes over one mesh and one picture, whose outputs all differ.
pub fn small_project(count: usize) -> Project {
    let project = Project::new();
    project.write("recipes/m.obj", TETRAHEDRON);
    project.write("recipes/e.png", picture(16, 0));
    for i in 0..count {
        let recipe = if i % 2 == 0 { MESH_RECIPE } else { CANVAS_RECIPE };
        let seed = format!("seed = {}\n", i + 1);
        let recipe = recipe.replace("[synthesis]\n", &format!("[synthesis]\n{seed}"));
        project.write(&format!("recipes/r{i}.toml"), recipe);
    }
    project
}

fn list(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() { list(&path, found) } else { found.push(path) }
    }
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("a folder");
    for entry in std::fs::read_dir(from).into_iter().flatten().flatten() {
        let (source, target) = (entry.path(), to.join(entry.file_name()));
        if source.is_dir() {
            copy(&source, &target);
        } else {
            std::fs::copy(&source, &target).expect("a copy");
        }
    }
}

/// A sphere of 24 x 12 quads as OBJ.
pub fn sphere() -> String {
    let (n, m) = (24u32, 12u32);
    let mut out = String::from("v 0 1 0\nv 0 -1 0\n");
    for j in 1..m {
        for i in 0..n {
            let (a, b) = (f64::from(i) / f64::from(n) * std::f64::consts::TAU, f64::from(j) / f64::from(m));
            let (s, c) = kiln::numerics::det::sin_cos(a);
            let (r, y) = kiln::numerics::det::sin_cos(b * std::f64::consts::PI);
            out += &format!("v {:.6} {:.6} {:.6}\n", r * s, y, r * c);
        }
    }
    let at = |i: u32, j: u32| 3 + (j - 1) * n + i % n;
    for i in 0..n {
        out += &format!("f 1 {} {}\nf 2 {} {}\n", at(i, 1), at(i + 1, 1), at(i + 1, m - 1), at(i, m - 1));
        for j in 1..m - 1 {
            out += &format!("f {} {} {} {}\n", at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
        }
    }
    out
}
