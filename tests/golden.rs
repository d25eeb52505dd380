//! Every recipe of the project, baked by the real program and compared with `golden/`: so no example can rot.
//!
//! The goldens were accepted from a release build; this is a debug build. Together with the thread counts below they
//! are the test of promise 1; other CPUs follow in `tests/slow/same_bytes.sh`.

mod common;

use common::Project;

#[test]
fn recipes_bake_to_their_goldens_for_any_number_of_threads() {
    let project = Project::with_recipes();
    for jobs in ["2", "1", "8"] {
        let ran = project.kiln(&["check", "-j", jobs]).expect(0);
        assert!(ran.out.ends_with("outputs are as accepted\n"), "-j {jobs}: {}", ran.out);
    }
    // The check left everything baked: there is nothing to do now.
    let ran = project.kiln(&["bake"]).expect(0);
    assert!(ran.out.starts_with("nothing to do: all "), "{}", ran.out);
}

#[test]
fn every_recipe_has_a_golden_book_and_every_book_a_recipe() {
    let names = |folder: &str| -> Vec<String> {
        let folder = std::fs::read_dir(common::root().join(folder)).expect("a folder of the project");
        let files = folder.map(|e| e.expect("an entry").path()).filter(|p| p.extension().is_some_and(|e| e == "toml"));
        let mut names: Vec<String> = files.map(|p| p.file_stem().expect("a name").to_string_lossy().into()).collect();
        names.sort();
        names
    };
    assert_eq!(names("recipes"), names("golden"));
    assert!(names("recipes").len() >= 8);
}
