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
        command.arg("-C").arg(self.0.path()).args(args).env_remove("CI").env("NO_COLOR", "1");
        command.envs(env.iter().copied());
        let Output { status, stdout, stderr } = command.output().expect("kiln runs");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("kiln prints UTF-8");
        Ran { code: status.code().unwrap_or(-1), out: text(stdout), err: text(stderr) }
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
