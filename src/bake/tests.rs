//! Tests of the whole path, by theory and against plain oracles.

use super::coverage::overlap_share;
use super::shade::{V3, cross, dot, mix, unit_or};
use super::testing::*;
use super::*;
use crate::mesh::{Surface, SynthesisMesh, TriMesh};
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::numerics::vec::{Vec3, vec3};
use crate::texture::{MapKind, Texture, Uv, texel};
use crate::uvset::{Blend, UvSets};

impl Bench {
    fn unwrapped(surface: Surface, synthesis: SynthesisMesh, size: u32) -> Bench {
        let atlas = unwrap(&surface, &page(size)).expect("a clean mesh");
        Bench::new(surface, synthesis, atlas, 4)
    }

    fn sphere(size: u32) -> Bench {
        let surface = sphere(3);
        let synthesis = synthesis(&surface);
        Bench::unwrapped(surface, synthesis, size)
    }

    fn scattered(&self, size: [u32; 2], blend: Blend) -> UvSets {
        scattered(&self.synthesis.mesh, size, self.atlas.texels_per_unit, blend)
    }
}

fn page(size: u32) -> UnwrapParams {
    UnwrapParams { extent: Extent::Page(size), gutter_px: 4, library: Library::Uvunwrap }
}

/// High contrast: every texel a colour of its own.
fn noise(size: u32) -> Texture {
    let key = Key::new(3);
    Texture::from_fn(size, size, 3, |x, y, out| {
        let key = key.with(u64::from(y * size + x));
        (0..).zip(out).for_each(|(k, o)| *o = key.unit(k) as f32);
    })
}

#[test]
fn a_plane_with_the_identity_mapping_is_the_sample() {
    let surface = plane(3);
    let atlas = Atlas::keep(&surface, 0, 64).expect("UVs of a square");
    assert_eq!(atlas.chart_count, 1);
    assert!((atlas.texels_per_unit - 64.0).abs() < 1e-6);
    let bench = Bench::new(surface.clone(), refined(&surface, 3), atlas, 4);
    assert_eq!(bench.coverage.share(), 1.0);
    let (sample, sets) = (noise(64), flat_set(&bench.synthesis.mesh, [64, 64], 64.0));
    let out = bench.bake(&sets, None, MapKind::BaseColor, &sample);
    let worst = out.data().iter().zip(sample.data()).fold(0.0f32, |m, (a, b)| m.max((a - b).abs()));
    assert!(worst < 1e-3, "{worst}");
}

#[test]
fn a_constant_sample_bakes_to_a_constant() {
    let bench = Bench::sphere(128);
    for blend in [Blend::Linear, Blend::Variance, Blend::Nearest] {
        let sets = bench.scattered([16, 16], blend);
        let grey = Texture::from_fn(16, 16, 1, |_, _, o| o[0] = 0.3);
        let out = bench.bake(&sets, None, MapKind::Roughness, &grey);
        assert!(out.data().iter().all(|v| (v - 0.3).abs() < 1e-5), "{blend:?}");
    }
}

#[test]
fn a_flat_normal_map_stays_flat_on_round_and_sharp_meshes() {
    let flat = Texture::from_fn(16, 16, 3, |_, _, o| o.copy_from_slice(&[0.0, 0.0, 1.0]));
    let cube_mesh = cube();
    let cube_synthesis = refined(&cube_mesh, 4);
    for bench in [Bench::sphere(128), Bench::unwrapped(cube_mesh, cube_synthesis, 128)] {
        let out = bench.bake(&bench.scattered([16, 16], Blend::Variance), None, MapKind::Normal, &flat);
        for n in out.data().chunks_exact(3) {
            assert!(n[0].abs() < 2e-3 && n[1].abs() < 2e-3 && n[2] > 0.999, "{n:?}");
        }
    }
}

#[test]
fn engines_decode_the_normals_that_the_sample_has_on_the_surface() {
    let bench = Bench::sphere(128);
    let sets = bench.scattered([16, 16], Blend::Nearest);
    let key = Key::new(5);
    let bumpy = Texture::from_fn(16, 16, 3, |x, y, o| {
        let k = key.with(u64::from(16 * (y / 4) + x / 4));
        let n = unit_or([k.unit(0) as f32 - 0.5, k.unit(1) as f32 - 0.5, 1.0], [0.0; 3]);
        o.copy_from_slice(&n);
    });
    let out = bench.bake(&sets, None, MapKind::Normal, &bumpy);
    let pyramid = Pyramid::<4>::new(&bumpy);
    let (mut checked, mut far) = (0, 0);
    for (x, y) in (0..128).flat_map(|y| (0..128).map(move |x| (x, y))) {
        let Some(f) = bench.coverage.face(x, y) else { continue };
        let b = super::coverage::clamp_bary(bench.coverage.to_bary(f).at(x as f32 + 0.5, y as f32 + 0.5));
        let corner = 3 * bench.synthesis.parent[f as usize] as usize;
        let n = mix(&[0, 1, 2].map(|k| bench.surface.corner_normals[corner + k].to_f32()), b);
        let t: V3 = mix(
            &[0, 1, 2].map(|k| {
                let t = bench.tangents[corner + k];
                [t[0], t[1], t[2]]
            }),
            b,
        );
        let bitangent = cross(n, t).map(|v| v * bench.tangents[corner][3]);
        let v = out.get(x, y);
        let decoded = unit_or(std::array::from_fn(|k| v[0] * t[k] + v[1] * bitangent[k] + v[2] * n[k]), n);
        let face = FaceSets::new(&sets, f as usize).with_frames(&bench.synthesis.mesh, f as usize);
        let wanted = face.normal(&pyramid, b, &[0.0; 4], unit_or(n, [0.0; 3]));
        checked += 1;
        far += u32::from(dot(decoded, wanted) < 0.999);
    }
    // Only texels along seams, which are moved, and under four taps differ: a quarter of so small an atlas (1796 of 7106).
    assert!(checked > 5000 && far < checked * 3 / 10, "{far} of {checked}");
}

/// Two triangles of a square, torn apart in the atlas, the second turned by 90 degrees.
fn torn_square() -> (Surface, Atlas) {
    let surface = plane(1);
    let uv = |x: f32, y: f32| Uv { u: x / 64.0, v: y / 64.0 };
    // (0,0) (1,0) (1,1) as it lies; (0,0) (1,1) (0,1) turned clockwise.
    let corner_uv = vec![uv(8.0, 28.0), uv(28.0, 28.0), uv(28.0, 8.0), uv(36.0, 36.0), uv(56.0, 56.0), uv(56.0, 36.0)];
    let atlas = Atlas { width: 64, height: 64, corner_uv, chart: vec![0, 1], chart_count: 2, texels_per_unit: 20.0 };
    (surface, atlas)
}

#[test]
fn normals_turn_with_the_chart_and_gutters_show_them_in_the_own_basis() {
    let (surface, atlas) = torn_square();
    let synthesis = synthesis(&surface);
    let bench = Bench::new(surface, synthesis, atlas, 4);
    let tilted = Texture::from_fn(20, 20, 3, |_, _, o| o.copy_from_slice(&[0.6, 0.0, 0.8]));
    let out = bench.bake(&flat_set(&bench.synthesis.mesh, [20, 20], 20.0), None, MapKind::Normal, &tilted);
    let near = |at: (u32, u32), n: [f32; 3]| {
        let v = out.get(at.0, at.1);
        assert!((0..3).all(|k| (v[k] - n[k]).abs() < 0.01), "{at:?}: {v:?}, wanted {n:?}");
    };
    // World +x is right in the first chart and down in the second; then the gutters across the diagonal.
    near((24, 24), [0.6, 0.0, 0.8]);
    near((52, 40), [0.0, -0.6, 0.8]);
    near((15, 17), [0.6, 0.0, 0.8]);
    near((44, 47), [0.0, -0.6, 0.8]);
}

#[test]
fn the_gutter_shows_the_surface_beyond_the_border() {
    let (surface, atlas) = torn_square();
    let synthesis = refined(&surface, 5);
    let bench = Bench::new(surface, synthesis, atlas, 4);
    let mut across = 0;
    for g in bench.coverage.gutter_in(0..64).iter().filter(|g| g.across != super::gutter::NO_BORDER) {
        let (x, y) = (f64::from(g.texel % 64) + 0.5, f64::from(g.texel / 64) + 0.5);
        // The square as the first chart would show it whole, and as the second would.
        let wanted =
            if x < 32.0 { [(x - 8.0) / 20.0, (28.0 - y) / 20.0] } else { [(y - 36.0) / 20.0, (x - 36.0) / 20.0] };
        let p = bench.synthesis.mesh.corners(g.face as usize);
        let p = p[0] * f64::from(g.bary[0]) + p[1] * f64::from(g.bary[1]) + p[2] * f64::from(g.bary[2]);
        if wanted.iter().all(|v| (0.05..0.95).contains(v)) {
            across += 1;
            assert!(
                (p.x - wanted[0]).abs() < 0.01 && (p.y - wanted[1]).abs() < 0.01,
                "{x}, {y}: {p:?}, not {wanted:?}"
            );
        }
    }
    assert!(across > 100, "{across}");
}

/// Distance inside (positive) of a point from the nearest edge of a triangle, in texels.
fn inside(p: [Vec3; 3], x: f64, y: f64) -> f64 {
    let area = (p[1] - p[0]).cross(p[2] - p[0]).z.signum();
    let edge = |i: usize| {
        let (a, d) = (p[i], p[(i + 1) % 3] - p[i]);
        area * (d.x * (y - a.y) - d.y * (x - a.x)) / d.length()
    };
    edge(0).min(edge(1)).min(edge(2))
}

#[test]
fn coverage_agrees_with_testing_every_texel_against_every_triangle() {
    let cube_mesh = cube();
    let cube_synthesis = refined(&cube_mesh, 3);
    let round = sphere(2);
    let round_synthesis = synthesis(&round);
    for bench in [Bench::unwrapped(round, round_synthesis, 96), Bench::unwrapped(cube_mesh, cube_synthesis, 96)] {
        let triangle = |f: usize| {
            let parent = bench.synthesis.parent[f] as usize;
            let px = [0, 1, 2].map(|k| bench.atlas.corner_px(3 * parent + k));
            bench.synthesis.parent_bary[f].map(|b| {
                let p = px[0] * f64::from(b[0]) + px[1] * f64::from(b[1]) + px[2] * f64::from(b[2]);
                vec3(p.x, p.y, 0.0)
            })
        };
        let triangles: Vec<_> = (0..bench.synthesis.parent.len()).map(triangle).collect();
        for (x, y) in (0..96u32).flat_map(|y| (0..96u32).map(move |x| (x, y))) {
            let depth = |t: &[Vec3; 3]| inside(*t, f64::from(x) + 0.5, f64::from(y) + 0.5);
            match bench.coverage.face(x, y) {
                Some(f) => assert!(depth(&triangles[f as usize]) > -0.01, "({x}, {y}) shows {f}"),
                None => assert!(triangles.iter().all(|t| depth(t) < 0.01), "({x}, {y}) shows nothing"),
            }
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_byte() {
    let run = |jobs| {
        par::install(jobs, || {
            let bench = Bench::sphere(128);
            let sets = bench.scattered([32, 32], Blend::Variance);
            let color = bench.bake(&sets, None, MapKind::BaseColor, &noise(32));
            let normal = Texture::from_fn(32, 32, 3, |x, _, o| {
                o.copy_from_slice(if x % 2 == 0 { &[0.6, 0.0, 0.8] } else { &[0.0, 0.6, 0.8] });
            });
            (color, bench.bake(&sets, None, MapKind::Normal, &normal), bench.atlas, bench.tangents)
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(8));
}

#[test]
fn both_sides_of_seams_show_the_same_on_every_stitched_level() {
    let surface = sphere(3);
    let params = UnwrapParams { gutter_px: default_gutter_px(1024), ..page(1024) };
    let atlas = unwrap(&surface, &params).expect("a sphere");
    let tangents = tangents(&surface, &atlas);
    let synthesis = synthesis(&surface);
    let coverage = Coverage::new(&surface, &synthesis, &atlas, &tangents, params.gutter_px).expect("they fit");
    let sets = scattered(&synthesis.mesh, [64, 64], atlas.texels_per_unit, Blend::Variance);
    // Noise with a spot size of a few texels, as photographs have.
    let rough = noise(16);
    let sample = Texture::from_fn(64, 64, 3, |x, y, o| {
        rough.sample(texel((x as f32 + 0.5) / 4.0, (y as f32 + 0.5) / 4.0), crate::texture::Wrap::Repeat, o);
    });
    let (surface, synthesis, atlas) = (&surface, &synthesis, &atlas);
    let inputs = Inputs {
        surface,
        synthesis,
        atlas,
        coverage: &coverage,
        tangents: &tangents,
        sets: &sets,
        sources: None,
        filter: Filter::Linear,
    };
    let out = bake_map(&inputs, MapKind::BaseColor, &sample).expect("they fit");
    for (mip, most) in [(0, 1.5), (1, 3.0), (2, 3.0), (3, 3.0)] {
        let found = seam_error(surface, atlas, MapKind::BaseColor, &out, mip);
        assert!(found.edges > 20 && found.mean < most, "mip {mip}: {found:?}");
    }
}

#[test]
fn minified_samples_do_not_alias() {
    let surface = plane(2);
    let atlas = Atlas::keep(&surface, 0, 32).expect("UVs of a square");
    let synthesis = synthesis(&surface);
    let bench = Bench::new(surface, synthesis, atlas, 4);
    let checks = Texture::from_fn(256, 256, 1, |x, y, o| o[0] = ((x + y) % 2) as f32);
    let out = bench.bake(&flat_set(&bench.synthesis.mesh, [256, 256], 256.0), None, MapKind::Height, &checks);
    assert!(
        out.data().iter().all(|v| (v - 0.5).abs() < 0.02),
        "{:?}",
        out.data().iter().fold(0.5f32, |m, v| m.max(*v))
    );
}

#[test]
fn variance_blending_stretches_what_differs_from_the_mean() {
    let sample = Texture::from_data(4, 1, 1, vec![0.0, 0.4, 0.6, 1.0]);
    let set = vec![texel(1.5, 0.5); 3];
    let mut sets = UvSets {
        exemplar_size: [4, 1],
        sets: vec![set.clone(), set.iter().map(|a| texel(a.x, a.y + 8.0)).collect()],
        weights: vec![[0.5, 0.5, 0.0, 0.0]; 3],
        blend: Blend::Variance,
        sharpness: 1,
        material: vec![],
    };
    let pyramid = Pyramid::<1>::new(&sample);
    let value = |sets: &UvSets| FaceSets::new(sets, 0).value(&pyramid, [0.2, 0.3, 0.5], &[0.0; 4])[0];
    assert!((value(&sets) - (0.5 - 0.1 / 0.5f32.sqrt())).abs() < 1e-6);
    // Where both sets show the same place nothing was lost.
    sets.sets[1] = sets.sets[0].clone();
    assert!((value(&sets) - 0.4).abs() < 1e-6);
    sets.blend = Blend::Linear;
    assert!((value(&sets) - 0.4).abs() < 1e-6);
}

#[test]
fn tangents_follow_the_page() {
    let surface = plane(2);
    let atlas = Atlas::keep(&surface, 0, 64).expect("UVs of a square");
    for t in tangents(&surface, &atlas) {
        assert!((t[0] - 1.0).abs() < 1e-6 && t[1].abs() < 1e-6 && t[2].abs() < 1e-6 && t[3] == 1.0, "{t:?}");
    }
}

/// A square with a triangle on a line, one on a point, one doubled and one turned over.
fn messy() -> Surface {
    let mut s = plane(2);
    let n = s.mesh.positions.len() as u32;
    s.mesh.positions.push(vec3(0.25, 0.0, 0.0));
    s.mesh.faces.extend([[0, n, 1], [4, 4, 4], s.mesh.faces[0], [1, 0, 4]]);
    let extra = s.mesh.faces.len() * 3 - s.corner_normals.len();
    s.corner_normals.extend(std::iter::repeat_n(vec3(0.0, 0.0, 1.0), extra));
    s
}

#[test]
fn degenerate_and_repeated_triangles_neither_fail_nor_spoil() {
    let surface = messy();
    let synthesis = synthesis(&surface);
    let bench = Bench::unwrapped(surface, synthesis, 64);
    let inside = |v: f32| (0.0..=1.0).contains(&v);
    assert!(bench.atlas.corner_uv.iter().all(|p| inside(p.u) && inside(p.v)));
    assert_eq!(bench.atlas.chart[8..10], [NO_CHART, NO_CHART]);
    assert_eq!(bench.atlas.chart[10], bench.atlas.chart[0]);
    assert_eq!(bench.atlas.corner_uv[30..33], bench.atlas.corner_uv[0..3]);
    let sets = bench.scattered([16, 16], Blend::Variance);
    assert!(bench.bake(&sets, None, MapKind::BaseColor, &noise(16)).data().iter().all(|v| v.is_finite()));
    let flat = Texture::from_fn(16, 16, 3, |_, _, o| o.copy_from_slice(&[0.0, 0.0, 1.0]));
    assert!(bench.bake(&sets, None, MapKind::Normal, &flat).data().iter().all(|v| v.is_finite()));
}

#[test]
fn unwrapping_keeps_charts_apart_and_the_density_asked_for() {
    for surface in [sphere(3), cube(), plane(4)] {
        let atlas = unwrap(&surface, &page(256)).expect("a clean mesh");
        assert_eq!((atlas.width, atlas.height), (256, 256));
        assert!(atlas.corner_uv.iter().all(|p| (0.0..=1.0).contains(&p.u) && (0.0..=1.0).contains(&p.v)));
        assert_eq!(overlap_share(&surface, &atlas), 0.0);
        assert!(atlas.chart.iter().all(|&c| c < atlas.chart_count));
        let density = UnwrapParams { extent: Extent::TexelsPerUnit(40.0), ..page(1) };
        let atlas = unwrap(&surface, &density).expect("a clean mesh");
        assert!((atlas.texels_per_unit - 40.0).abs() < 0.4, "{}", atlas.texels_per_unit);
        assert_eq!((atlas.width % 4, atlas.height % 4), (0, 0));
    }
}

#[test]
fn charts_are_not_mirrored_on_the_page() {
    let surface = sphere(2);
    let atlas = unwrap(&surface, &page(128)).expect("a sphere");
    for f in 0..surface.mesh.faces.len() {
        let [a, b, c] = [0, 1, 2].map(|k| atlas.corner_px(3 * f + k));
        assert!((b - a).cross(c - a) < 0.0, "counter-clockwise with y up is negative with y down");
    }
}

#[test]
fn what_cannot_be_unwrapped_is_said() {
    let with = |extent, gutter_px| UnwrapParams { extent, gutter_px, library: Library::Uvunwrap };
    let plane = plane(1);
    let fails = |surface: &Surface, params: UnwrapParams| unwrap(surface, &params).expect_err("a fault").to_string();
    assert_eq!(fails(&plane, with(Extent::Page(8), 2)), "atlas size = 8, expected 16..=16384");
    assert_eq!(
        fails(&plane, with(Extent::TexelsPerUnit(f64::NAN), 2)),
        "texels_per_unit = NaN, expected a positive number"
    );
    assert!(
        fails(&plane, with(Extent::TexelsPerUnit(1e9), 2)).starts_with("the atlas would be 1000000000 texels wide")
    );
    assert_eq!(fails(&plane, with(Extent::Page(64), 9)), "gutter = 9 texels on a page of 64, expected at most 8");
    let flat = surface(vec![Vec3::ZERO; 3], vec![[0, 1, 2]]);
    assert!(fails(&flat, page(64)).starts_with("none of the 1 triangles has an area"));
    assert!(fails(&surface(vec![], vec![]), page(64)).starts_with("none of the 0 triangles"));
    let stopped = unwrap_watched(&sphere(3), &page(64), &|| false);
    assert_eq!(stopped, Err(Error::Cancelled));
    let many = {
        let mut m = TriMesh::default();
        for i in 0..3000u32 {
            let at = vec3(f64::from(i % 60) * 3.0, f64::from(i / 60) * 3.0, 0.0);
            m.positions.extend([at, at + vec3(1.0, 0.0, 0.0), at + vec3(0.0, 1.0, 0.0)]);
            m.faces.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        surface(m.positions, m.faces)
    };
    assert!(fails(&many, with(Extent::Page(64), 8)).contains("do not fit a page of 64"));
}

#[test]
fn the_surface_keeps_its_own_uvs_only_if_they_can_be_baked_to() {
    let mut s = plane(2);
    assert_eq!(Atlas::keep(&s, 1, 64), Err(Error::NoUvSet { set: 1, available: 1 }));
    // Folded: every triangle on the left half.
    s.corner_uvs[0].iter_mut().for_each(|p| p.u = 0.5 - (p.u - 0.5).abs());
    assert!(matches!(Atlas::keep(&s, 0, 64), Err(Error::UvOverlap { share }) if share > 0.5));
    s.corner_uvs[0][4].u = 1.5;
    assert_eq!(Atlas::keep(&s, 0, 64), Err(Error::UvOutside { face: 1, uv: [1.5, s.corner_uvs[0][4].v] }));
    s.corner_uvs[0][4].u = f32::NAN;
    assert!(matches!(Atlas::keep(&s, 0, 64), Err(Error::UvOutside { face: 1, .. })));
}

#[test]
fn inputs_that_do_not_belong_together_are_refused() {
    let bench = Bench::sphere(64);
    let mut sets = bench.scattered([16, 16], Blend::Linear);
    sets.sets[1].pop();
    let Bench { surface, synthesis, atlas, tangents, coverage } = &bench;
    let inputs =
        Inputs { surface, synthesis, atlas, coverage, tangents, sets: &sets, sources: None, filter: Filter::Linear };
    let found = bake_map(&inputs, MapKind::BaseColor, &noise(16)).expect_err("a corner is missing");
    assert_eq!(found.to_string(), "corners in a set: found 1535, expected 1536");
}

#[cfg(not(feature = "xatlas"))]
#[test]
fn xatlas_tells_how_to_get_it() {
    let params = UnwrapParams { library: Library::Xatlas, ..page(64) };
    let error = unwrap(&plane(1), &params).expect_err("not in this build").to_string();
    assert!(error.contains("--features xatlas"), "{error}");
}

#[cfg(feature = "xatlas")]
#[test]
fn xatlas_fills_a_page_without_overlap() {
    for surface in [sphere(3), cube(), messy()] {
        let atlas = unwrap(&surface, &UnwrapParams { library: Library::Xatlas, ..page(256) }).expect("a clean mesh");
        assert_eq!((atlas.width, atlas.height), (256, 256));
        assert!(overlap_share(&surface, &atlas) < 1e-3);
        assert!(atlas.utilization(&surface) > 0.3, "{}", atlas.utilization(&surface));
        assert!(atlas.corner_uv.iter().all(|p| (0.0..=1.0).contains(&p.u) && (0.0..=1.0).contains(&p.v)));
    }
}

#[test]
fn a_real_mesh_bakes_without_visible_seams() {
    let Some(surface) = shared_mesh("spot") else { return };
    let atlas = unwrap(&surface, &UnwrapParams { gutter_px: 10, ..page(1024) }).expect("spot");
    assert!(atlas.utilization(&surface) > 0.5, "{}", atlas.utilization(&surface));
    let synthesis = synthesis(&surface);
    let tangents = tangents(&surface, &atlas);
    let coverage = Coverage::new(&surface, &synthesis, &atlas, &tangents, 10).expect("they fit");
    let sets = scattered(&synthesis.mesh, [64, 64], atlas.texels_per_unit, Blend::Variance);
    let (surface, synthesis, atlas) = (&surface, &synthesis, &atlas);
    let inputs = Inputs {
        surface,
        synthesis,
        atlas,
        coverage: &coverage,
        tangents: &tangents,
        sets: &sets,
        sources: None,
        filter: Filter::Linear,
    };
    let out = bake_map(&inputs, MapKind::BaseColor, &noise(64)).expect("they fit");
    let found = seam_error(surface, atlas, MapKind::BaseColor, &out, 0);
    assert!(found.edges > 1000 && found.mean < 2.0, "white noise: {found:?}");
}

/// Blends of three random places over a face against the sample itself: mean distance of the sorted values (the
/// Wasserstein distance of their histograms).
#[test]
fn variance_blending_and_sharper_weights_keep_the_histogram() {
    let draws = Key::new(8);
    let sample = Texture::from_fn(64, 64, 1, |x, y, out| {
        let v = draws.with(u64::from(y / 3)).unit(u64::from(x / 3)) as f32;
        out[0] = v * v;
    });
    let pyramid = Pyramid::<1>::new(&sample);
    let distance = |blend: Blend, sharpness: u32| {
        let mut values: Vec<f32> = (0..4096u64)
            .map(|i| {
                let d = draws.with_str("face").with(i);
                let place = |s: u64| texel(1.0 + 62.0 * d.unit(2 * s) as f32, 1.0 + 62.0 * d.unit(2 * s + 1) as f32);
                let sets = (0..3).map(|s| vec![place(s); 3]).collect();
                let weights = vec![[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
                let sets = UvSets { exemplar_size: [64, 64], sets, weights, blend, sharpness, material: vec![] };
                let (a, b) = (d.unit(8) as f32, d.unit(9) as f32);
                let bary = if a + b > 1.0 { [a + b - 1.0, 1.0 - a, 1.0 - b] } else { [1.0 - a - b, a, b] };
                FaceSets::new(&sets, 0).value(&pyramid, bary, &[0.0; 4])[0]
            })
            .collect();
        let mut own = sample.data().to_vec();
        values.sort_unstable_by(f32::total_cmp);
        own.sort_unstable_by(f32::total_cmp);
        values.iter().zip(&own).map(|(a, b)| (a - b).abs()).sum::<f32>() / own.len() as f32
    };
    let (linear, variance, sharp) =
        (distance(Blend::Linear, 1), distance(Blend::Variance, 1), distance(Blend::Linear, 6));
    println!("histogram distances: linear {linear}, variance {variance}, sharpened {sharp}");
    assert!(variance < 0.6 * linear && sharp < 0.6 * linear, "{linear} {variance} {sharp}");
}

#[test]
fn cubic_interpolation_keeps_texels_and_parabolas_and_stays_within_range() {
    // A parabola along x: Catmull-Rom gives it back between its texels.
    let v = |x: f32| 0.01 * (x + 1.0) * (x + 1.0);
    let sample = Texture::from_fn(8, 4, 1, |x, _, out| out[0] = v(x as f32 + 0.5));
    let [p, tile] = [Pyramid::<1>::new(&sample), Pyramid::<1>::tile(&[&sample])].map(|p| p.filtered(Filter::Cubic));
    for x in [1.5, 2.0, 3.3, 4.75, 6.5] {
        for p in [&p, &tile] {
            assert!((p.sample_at(texel(x, 2.0), 0.0, 0.0)[0] - v(x)).abs() < 1e-6, "{x}");
        }
    }
    assert_eq!(
        (tile.sample(texel(0.0, 0.5), 0.0), p.sample(texel(-5.0, 9.0), 0.0)),
        (tile.sample(texel(8.0, 4.5), 0.0), [v(0.5)])
    );
    assert!(p.sample(texel(f32::NAN, f32::INFINITY), 0.0)[0].is_finite());
    // A step does not ring.
    let step = Texture::from_fn(8, 1, 1, |x, _, out| out[0] = if x < 4 { 0.25 } else { 0.75 });
    let p = Pyramid::<1>::new(&step).filtered(Filter::Cubic);
    assert!((0..80).all(|i| (0.25..=0.75).contains(&p.sample(texel(i as f32 * 0.1, 0.5), 0.0)[0])));
}

#[test]
fn a_tile_wraps_and_lies_between_its_layers() {
    let layer = |v: f32| Texture::from_fn(4, 2, 1, |x, y, out| out[0] = v + (4 * y + x) as f32);
    let [a, b, c] = [layer(0.0), layer(100.0), layer(300.0)];
    let p = Pyramid::<1>::tile(&[&a, &b, &c]);
    let at = |x: f32, y: f32, m: f32| p.sample_at(texel(x, y), m, 0.0)[0];
    assert_eq!((at(0.5, 0.5, 0.0), at(0.5, 0.5, 0.5), at(0.5, 0.5, 1.0)), (0.0, 100.0, 300.0));
    assert_eq!((at(0.5, 0.5, 0.25), at(1.5, 0.5, 7.0), at(1.5, 0.5, -1.0)), (50.0, 301.0, 1.0));
    assert_eq!((at(4.0, 0.5, 0.0), at(0.0, 0.5, 0.0), at(-8.0, 2.5, 0.0)), (1.5, 1.5, 1.5));
    assert!(at(f32::NAN, f32::INFINITY, f32::NAN).is_finite());
    assert_eq!(p.sample_at(texel(9.0, -3.0), 0.5, 9.0)[0], 103.5, "the coarsest level is the layer's mean");
    // On a mesh: one look-up each, m falling from 1 to 0 along x.
    let t = [texel(0.0, 0.0), texel(4.0, 0.0), texel(4.0, 2.0)].to_vec();
    let weights = vec![[1.0, 0.0, 0.0, 0.0]; 3];
    let material = vec![1.0, 0.0, 0.0];
    let sets = UvSets { exemplar_size: [4, 2], sets: vec![t], weights, blend: Blend::Linear, sharpness: 1, material };
    let value = FaceSets::new(&sets, 0).value(&p, [0.25, 0.5, 0.25], &[0.0; 4])[0];
    assert_eq!(value, at(3.0, 0.5, 0.25));
}
