//! Whatever happened to the tree before, a run leaves what a first run on an empty cache would make.

use std::path::Path;

use proptest::prelude::*;

use super::world::{MemoryDisk, Toy, later, options};
use super::*;
use crate::disk::Disk;

const FILES: usize = 4;

/// A step of a random graph: which earlier things it reads, and its parameter.
type Spec = (usize, usize, u8);

/// The graph; the work of step `faulty` fails.
fn graph_of(specs: &[Spec], faulty: Option<usize>) -> Graph {
    let mut graph = Graph::new();
    let mut ids: Vec<InputId> = (0..FILES).map(|file| graph.add_file(format!("in/{file}"))).collect();
    for (index, (a, b, param)) in specs.iter().enumerate() {
        let name = format!("step {index}");
        let mut toy = match param % 3 {
            0 => Toy::upper(&name),
            1 => Toy::count(&name),
            _ => Toy::concat(&name, &param.to_string()),
        };
        if faulty == Some(index) {
            toy.work = Toy::fails(&name).work;
        }
        let inputs = [ids[a % ids.len()], ids[b % ids.len()]];
        let step = graph.add_step(Box::new(toy), &inputs);
        ids.push(step.into());
        if index % 2 == 0 {
            graph.add_output(step, format!("out/{index}"));
        }
    }
    graph
}

fn happen(disk: &MemoryDisk, specs: &mut [Spec], (event, which): (u8, usize)) {
    let file = format!("in/{}", which % FILES);
    let output = format!("out/{}", which % specs.len());
    let nth = |paths: Vec<std::path::PathBuf>| (!paths.is_empty()).then(|| paths[which % paths.len()].clone());
    let damage = |path: &Path| disk.put_unnoticed(path, &vec![b'#'; disk.read(path, 1 << 20).unwrap().len()]);
    match event {
        0 => disk.put(&file, &which.to_string()),
        1 => disk.put(&file, &disk.text(&file).unwrap()),
        2 => disk.remove(Path::new(&output)).unwrap(),
        3 if disk.text(&output).is_some() => disk.put(&output, "scribble"),
        4 => nth(disk.paths(".kiln/cache")).iter().for_each(|path| damage(path)),
        5 => nth(disk.paths(".kiln/cache")).iter().for_each(|path| disk.remove(path).unwrap()),
        6 => disk.paths(".kiln/cache/blobs").iter().for_each(|path| damage(path)),
        7 => disk.paths(".kiln/manifest").iter().for_each(|path| damage(path)),
        8 => Cache::new(disk, ".kiln/cache").clear().unwrap(),
        _ => {
            let step = which % specs.len();
            specs[step].2 = (which % 7) as u8;
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    #[test]
    fn any_history_ends_as_a_first_run_does(
        mut specs in prop::collection::vec((0..100usize, 0..100usize, 0..7u8), 1..12),
        history in prop::collection::vec(prop::collection::vec((0..10u8, 0..100usize), 1..4), 1..6),
        faulty in 0..20usize,
        jobs in 1..4usize,
        hold_bytes in prop::sample::select(vec![0, 8, 1 << 20]),
    ) {
        let disk = MemoryDisk::new(&[]);
        (0..FILES).for_each(|file| disk.put(&format!("in/{file}"), &format!("file {file}")));
        for events in history {
            events.iter().for_each(|event| happen(&disk, &mut specs, *event));
            disk.tick();
            let options = Options { hold_bytes, ..options(jobs) };
            let keep_going = Options { keep_going: true, ..options.clone() };
            run(&graph_of(&specs, Some(faulty)), &[], &keep_going, &disk, &Silent).unwrap();
            let report = run(&graph_of(&specs, None), &[], &options, &disk, &Silent).unwrap();
            prop_assert!(report.is_success(), "{:?}", report.failures().collect::<Vec<_>>());
            let fresh = MemoryDisk::new(&[]);
            (0..FILES).for_each(|file| fresh.put(&format!("in/{file}"), &disk.text(&format!("in/{file}")).unwrap()));
            later(&graph_of(&specs, None), &fresh);
            for path in fresh.paths("out") {
                let path = path.display().to_string();
                prop_assert_eq!(disk.text(&path), fresh.text(&path), "{}", path);
            }
            prop_assert!(later(&graph_of(&specs, None), &disk).is_noop());
        }
    }
}
