//! `cargo bench`: what each kernel takes, median of several runs, on the project's own samples and, where it is there, on
//! the development data's bunny. `cargo bench -- walk` runs only what has "walk" in its name.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use kiln::bake::{self, Coverage, Extent, Library, UnwrapParams, bake_map, default_gutter_px, tangents};
use kiln::exemplar::{AnalysisParams, JumpMap, TextonParams, analyse, analyse_textons, appearance};
use kiln::field::{self, Field, SingularityConstraint, SingularityKind, Symmetry};
use kiln::io::SampleType;
use kiln::io::image_file::{Compression, Transfer, encode_exr, encode_png};
use kiln::io::image_quantise::{Encoding, quantise};
use kiln::io::image_set::{Options, Slot, load};
use kiln::io::scene::Document;
use kiln::mesh::{PrepareParams, Surface, Topology, TriMesh, prepare};
use kiln::numerics::vec::vec3;
use kiln::numerics::{det, par};
use kiln::synth::image::copy::{BlendKernel, copy};
use kiln::synth::image::order::ImageOrder;
use kiln::synth::image::walk::{self, ImageWalkParams};
use kiln::synth::mesh::corner::{Base, corner_sets};
use kiln::synth::mesh::layers::layered_sets;
use kiln::synth::mesh::order::region_growing;
use kiln::synth::mesh::rendering_sequence::{CACHE, acmr, face_sequence, rendering_sequence};
use kiln::synth::mesh::sites::Sites;
use kiln::synth::mesh::walk::{VertexWalkParams, walk};
use kiln::synth::quilt::frame::Facets;
use kiln::synth::quilt::{QuiltParams, quilt};
use kiln::synth::seam_metric::SeamMetrics;
use kiln::texture::{MapKind, MapSet};
use kiln::tile::{KeyTile, TileParams, make, seamless};
use kiln::uvset::Blend;

/// Runs what the command line's filter lets through and prints a line for each.
struct Bench {
    filter: String,
}

impl Bench {
    /// Times `work` five times; `amount` of `unit` per run is shown as a rate.
    fn run<R>(&self, name: &str, amount: f64, unit: &str, mut work: impl FnMut() -> R) {
        if !name.contains(&self.filter) {
            return;
        }
        let mut times: Vec<Duration> = (0..5)
            .map(|_| {
                let begun = Instant::now();
                std::hint::black_box(work());
                begun.elapsed()
            })
            .collect();
        times.sort();
        let t = times[2].as_secs_f64();
        println!("{name:44} {:10.2} ms   {:10.2} {unit}", t * 1e3, amount / t);
    }
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn maps(folder: &str) -> MapSet {
    let read = |name: &str| std::fs::read(root().join("recipes/assets").join(folder).join(name)).expect("a sample");
    let (color, normal, height) = (read("base_color.png"), read("normal.png"), read("height.png"));
    let slot = |kind, bytes| (Slot::Map(kind), folder, bytes);
    let slots =
        [slot(MapKind::BaseColor, &color[..]), slot(MapKind::Normal, &normal[..]), slot(MapKind::Height, &height[..])];
    load(&slots, &Options::default()).expect("our own samples load")
}

fn surface(path: &Path) -> Option<Surface> {
    let bytes = std::fs::read(path).ok()?;
    let mut none = |_: &str| Err("no other files".to_string());
    Document::parse("mesh", &bytes, &mut none).ok()?.surface(None).ok()
}

fn main() {
    let filter = std::env::args().skip(1).find(|a| !a.starts_with("--")).unwrap_or_default();
    let bench = Bench { filter };
    let pebbles = maps("pebbles");
    analysis(&bench, &pebbles);
    flat(&bench, &pebbles);
    textons(&bench, &pebbles);
    tiles(&bench, &pebbles);
    encode(&bench);
    let knot = surface(&root().join("recipes/assets/meshes/knot.glb")).expect("our own mesh");
    on_surface(&bench, "knot", &knot, &pebbles, 220.0, 1024);
    match surface(&root().join("../shared/data/meshes/glb/stanford-bunny.glb")) {
        Some(bunny) => on_surface(&bench, "bunny", &bunny, &pebbles, 3000.0, 4096),
        None => println!("the development data's bunny is not here"),
    }
    no_op(&bench);
}

fn analysis(bench: &Bench, pebbles: &MapSet) {
    for (name, set) in [("pebbles 256x256", pebbles), ("bricks 256x192", &maps("bricks"))] {
        let texels = f64::from(set.width()) * f64::from(set.height());
        for jobs in [1, 2] {
            bench.run(&format!("analyse {name}, -j {jobs}"), texels / 1e3, "ktexel/s", || {
                par::install(jobs, || analyse(set, &AnalysisParams::default()))
            });
        }
    }
    for neighbourhoods in [vec![5], vec![7], vec![5, 3]] {
        let params = AnalysisParams { neighbourhoods, ..AnalysisParams::default() };
        bench.run(&format!("appearance pebbles {:?}, -j 2", params.neighbourhoods), 65.536, "ktexel/s", || {
            par::install(2, || appearance(pebbles, &params, 8))
        });
    }
}

/// Samples that are made to wrap, and a tile of eight layers from two of them.
fn tiles(bench: &Bench, pebbles: &MapSet) {
    let bark = maps("bark");
    let keys = [pebbles, &bark].map(|maps| KeyTile { maps, tileable: false });
    bench.run("seamless pebbles 256x256, -j 1", 65.536, "ktexel/s", || {
        par::install(1, || seamless(pebbles, &TileParams::default().importance))
    });
    for jobs in [1, 2] {
        bench.run(&format!("tile pebbles to bark 256x256x8, -j {jobs}"), 8.0, "layers/s", || {
            par::install(jobs, || make(&keys, &TileParams::default()))
        });
    }
}

/// A torus of `2 * sides * sides` triangles, its field along the small circles; the mean edge takes ten texels.
fn torus(sides: u32) -> Facets {
    let turn = |i: u32| std::f64::consts::TAU * f64::from(i % sides) / f64::from(sides);
    let at = |i: u32| (det::sin_cos(turn(i / sides)), det::sin_cos(turn(i % sides)));
    let point = |i: u32| {
        let ((s, c), (t, d)) = at(i);
        vec3((1.0 + 0.4 * d) * c, (1.0 + 0.4 * d) * s, 0.4 * t)
    };
    let up = |i: u32| {
        let ((s, c), (t, d)) = at(i);
        vec3(-t * c, -t * s, d)
    };
    let index = |x: u32, y: u32| (x % sides) * sides + y % sides;
    let squares = (0..sides * sides).map(|i| (i / sides, i % sides));
    let faces = squares.flat_map(|(x, y)| {
        let [a, b, c, d] = [index(x, y), index(x + 1, y), index(x + 1, y + 1), index(x, y + 1)];
        [[a, b, c], [a, c, d]]
    });
    let mesh = TriMesh { positions: (0..sides * sides).map(point).collect(), faces: faces.collect() };
    let scale = 10.0 * f64::from(sides) / 5.0;
    let field = Field { up: (0..sides * sides).map(up).collect(), scale: vec![scale as f32; (sides * sides) as usize] };
    Facets::new(&mesh, &field, Symmetry::One)
}

fn textons(bench: &Bench, pebbles: &MapSet) {
    let params = |count| TextonParams { count: Some(count), ..TextonParams::default() };
    for jobs in [1, 2] {
        bench.run(&format!("textons 256x256, 256 of 11x11, -j {jobs}"), 65.536, "ktexel/s", || {
            par::install(jobs, || analyse_textons(pebbles, &params(256)))
        });
    }
    let (map, _) = analyse_textons(pebbles, &params(256)).expect("an analysis");
    let metrics = SeamMetrics::new(pebbles, &AnalysisParams::default()).expect("checked maps");
    for (sides, refine) in [(64, 0), (64, 2), (256, 0), (708, 0), (708, 2)] {
        let facets = torus(sides);
        let faces = facets.len() as f64;
        for jobs in [1, 2] {
            let name = format!("quilt {faces} faces, refine {refine}, -j {jobs}");
            let params = QuiltParams { refine, ..QuiltParams::default() };
            bench.run(&name, faces / 1e6, "Mface/s", || {
                par::install(jobs, || quilt(&map, &facets, Some(&metrics), &params))
            });
        }
    }
}

fn flat(bench: &Bench, set: &MapSet) {
    let (map, _) = analyse(set, &AnalysisParams::default()).expect("an analysis");
    let orders =
        [("scanline", ImageOrder::Scanline), ("serpentine", ImageOrder::Serpentine), ("hilbert", ImageOrder::Hilbert)];
    for (name, order) in orders {
        let params = ImageWalkParams { size: [1024, 1024], order, patch: 1.0, seed: 1, tileable: false };
        bench.run(&format!("walk image 1024x1024 {name}, one core"), 1.048_576, "Mpixel/s", || {
            walk::walk(&map, &params)
        });
    }
    let params =
        ImageWalkParams { size: [1024, 1024], order: ImageOrder::Hilbert, patch: 1.0, seed: 1, tileable: false };
    let sources = walk::walk(&map, &params).expect("a walk");
    let color = set.get(MapKind::BaseColor).expect("a colour");
    bench.run("copy image 1024x1024, blended 3x3", 1.048_576, "Mpixel/s", || copy(color, &sources, BlendKernel::Three));
}

fn encode(bench: &Bench) {
    let color = maps("pebbles");
    let color = color.get(MapKind::BaseColor).expect("a colour");
    let large = kiln::texture::Texture::from_fn(4096, 4096, 3, |x, y, out| {
        out.copy_from_slice(color.get(x % color.width(), y % color.height()));
    });
    bench.run("quantise 4096x4096 RGB to sRGB 8 bit", 16.777, "Mpixel/s", || {
        quantise(&large, Encoding::Color, SampleType::U8)
    });
    let pixels = quantise(&large, Encoding::Color, SampleType::U8).expect("finite");
    bench.run("encode PNG 4096x4096 RGB, fast", 16.777, "Mpixel/s", || {
        encode_png(&pixels, Compression::Fast, Transfer::Srgb)
    });
    let small = kiln::texture::Texture::from_fn(1024, 1024, 3, |x, y, out| out.copy_from_slice(large.get(x, y)));
    let floats = quantise(&small, Encoding::Color, SampleType::F32).expect("finite");
    bench.run("encode EXR 1024x1024 RGB", 1.049, "Mpixel/s", || encode_exr(&floats));
}

fn on_surface(bench: &Bench, name: &str, surface: &Surface, set: &MapSet, scale: f64, page: u32) {
    let params = PrepareParams::new(scale, [set.width(), set.height()]);
    let faces = surface.mesh.faces.len() as f64;
    bench.run(&format!("{name}: prepare"), faces / 1e3, "kface/s", || prepare(surface, &params));
    let prepared = prepare(surface, &params).expect("a synthesis mesh");
    let mesh = &prepared.mesh;
    let vertices = mesh.positions.len() as f64;
    let topology = Topology::new(mesh);
    let normals = mesh.vertex_normals();
    let orient = || field::orientation(mesh, &topology, &normals, &[], &[], &[], Symmetry::One).expect("a field");
    bench.run(&format!("{name}: orientation, one core"), vertices / 1e3, "kvertex/s", || par::install(1, orient));
    // The knot is a torus and the bunny has holes below: both take these.
    let point = |v: usize, index| SingularityConstraint {
        at: mesh.positions[v],
        kind: SingularityKind::Index(index),
        radius: None,
    };
    let points = [point(0, 1.0), point(mesh.positions.len() / 2, -1.0)];
    let asked = || field::orientation(mesh, &topology, &normals, &[], &points, &[], Symmetry::One).expect("a field");
    bench.run(&format!("{name}: orientation, two singularities, one core"), vertices / 1e3, "kvertex/s", || {
        par::install(1, asked)
    });
    let up = orient();
    let field = Field { up, scale: vec![scale as f32; mesh.positions.len()] };
    let edges = || field::edge_offsets(mesh, &topology, &normals, &field, Symmetry::One);
    bench.run(&format!("{name}: edge offsets"), vertices / 1e3, "kvertex/s", edges);
    let offsets = edges();
    bench.run(&format!("{name}: region growing, one core"), vertices / 1e6, "Mvertex/s", || {
        region_growing(&topology, &[])
    });
    bench.run(&format!("{name}: rendering sequence, one core"), vertices / 1e6, "Mvertex/s", || {
        rendering_sequence(mesh, &topology)
    });
    let sequence: Vec<_> = face_sequence(mesh, &topology).iter().map(|&f| mesh.faces[f as usize]).collect();
    for cache in [16, CACHE, 32] {
        let ratio = |faces: &[[u32; 3]]| acmr(faces, mesh.positions.len(), cache);
        println!("{name}: acmr {:.3}, as a sequence {:.3}, cache {cache}", ratio(&mesh.faces), ratio(&sequence));
    }
    let order = region_growing(&topology, &[]).expect("an order");
    let (map, _) = analyse(set, &AnalysisParams::default()).expect("an analysis");
    let params = VertexWalkParams::default();
    let go = || walk(&map, &topology, &offsets, None, &order, &params).expect("a walk");
    bench.run(&format!("{name}: walk, one core"), vertices / 1e6, "Mvertex/s", || par::install(1, go));
    let walked = go();
    let size = [set.width(), set.height()];
    let corners = || corner_sets(&mesh.faces, &topology, &offsets, &walked.address, size, Base::Three, Blend::Linear);
    bench.run(&format!("{name}: corners"), mesh.faces.len() as f64 / 1e6, "Mface/s", corners);
    let sets = corners().expect("corner coordinates");
    // As on a finer mesh: edges of a quarter of the distance of sites.
    let mean = offsets.iter().map(|d| d.length()).sum::<f64>() / offsets.len() as f64;
    let place = || Sites::new(&topology, &offsets, 4.0 * mean, false).expect("sites");
    bench.run(&format!("{name}: sites four edges apart, one core"), vertices / 1e6, "Mvertex/s", || {
        par::install(1, place)
    });
    let sites = place();
    let order = region_growing(&sites.topology, &[]).expect("an order");
    let boxes = Some(&sites.boxes[..]);
    let address = walk(&map, &sites.topology, &sites.offsets, boxes, &order, &params).map(|w| w.address);
    if let Ok(address) = address {
        bench.run(&format!("{name}: layered corners, one core"), mesh.faces.len() as f64 / 1e6, "Mface/s", || {
            par::install(1, || layered_sets(&mesh.faces, &sites, &address, size, Blend::Linear))
        });
    }
    // What a recipe does without a correction: sites a thirty-second of the sample apart.
    let (stored, spacing) = (map.to_bytes(), f64::from(size[0].min(size[1])) / 32.0);
    let whole = || {
        let map = JumpMap::from_bytes(&stored).expect("a jump map");
        let topology = Topology::new(mesh);
        let offsets = field::edge_offsets(mesh, &topology, &normals, &field, Symmetry::One);
        let Some(sites) = Sites::new(&topology, &offsets, spacing, false) else {
            let order = region_growing(&topology, &[]).expect("an order");
            let address = walk(&map, &topology, &offsets, None, &order, &params).expect("a walk").address;
            return corner_sets(&mesh.faces, &topology, &offsets, &address, size, Base::Three, Blend::Linear).ok();
        };
        let order = region_growing(&sites.topology, &[]).expect("an order");
        let boxes = Some(&sites.boxes[..]);
        let address = walk(&map, &sites.topology, &sites.offsets, boxes, &order, &params).expect("a walk").address;
        layered_sets(&mesh.faces, &sites, &address, size, Blend::Linear).ok()
    };
    bench.run(
        &format!("{name}: stored analysis to UV sets, one core"),
        mesh.faces.len() as f64 / 1e6,
        "Mface/s",
        || par::install(1, whole),
    );
    let layout = |side: u32| UnwrapParams {
        extent: Extent::Page(side),
        gutter_px: default_gutter_px(side),
        library: Library::Uvunwrap,
    };
    bench.run(&format!("{name}: unwrap"), faces / 1e3, "kface/s", || bake::unwrap(surface, &layout(1024)));
    let atlas = bake::unwrap(surface, &layout(page)).expect("an atlas");
    let tangents = tangents(surface, &atlas);
    let cover = || Coverage::new(surface, &prepared, &atlas, &tangents, default_gutter_px(page)).expect("a coverage");
    let texels = f64::from(page) * f64::from(page) / 1e6;
    bench.run(&format!("{name}: coverage {page}"), texels, "Mtexel/s", cover);
    let coverage = cover();
    let inputs = bake::Inputs {
        surface,
        synthesis: &prepared,
        atlas: &atlas,
        coverage: &coverage,
        tangents: &tangents,
        sets: &sets,
        sources: None,
        filter: bake::Filter::Cubic,
    };
    for kind in [MapKind::BaseColor, MapKind::Normal, MapKind::Height] {
        let source = set.get(kind).expect("a map");
        bench.run(&format!("{name}: rasterise {} {page}", kind.name()), texels, "Mtexel/s", || {
            bake_map(&inputs, kind, source)
        });
    }
}

/// The whole program with nothing to do, on the project's own recipes.
fn no_op(bench: &Bench) {
    let kiln = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kiln"));
        command.arg("-C").arg(root()).args(["bake", "-q"]);
        let ran = command.output().expect("kiln runs");
        assert!(ran.status.success(), "the recipes bake");
    };
    if "no-op bake of recipes/".contains(&bench.filter) {
        kiln();
        bench.run("no-op bake of recipes/, whole process", 1.0, "runs/s", kiln);
    }
}
