use super::*;
use crate::exemplar::{AnalysisParams, TextonParams, analyse_textons};
use crate::field::{Field, Symmetry};
use crate::mesh::zoo;
use crate::numerics::vec::vec3;
use crate::texture::{MapKind, MapSet, Texture, Wrap};

fn noise(x: u32, y: u32) -> f32 {
    let key = Key::new(11);
    let at = |x: u32, y: u32| key.with(u64::from(x)).unit(u64::from(y)) as f32;
    let (u, v) = ((x % 4) as f32 / 4.0, (y % 4) as f32 / 4.0);
    let (x, y) = (x / 4, y / 4);
    at(x, y) * (1.0 - u) * (1.0 - v)
        + at(x + 1, y) * u * (1.0 - v)
        + at(x, y + 1) * (1.0 - u) * v
        + at(x + 1, y + 1) * u * v
}

fn textons(size: u32, rotations: u32, f: impl Fn(u32, u32) -> f32 + Sync) -> TextonMap {
    let t = Texture::from_fn(size, size, 1, |x, y, out| out[0] = f(x, y));
    let params = TextonParams { window: 7, rotations, wrap: Wrap::Clamp, ..TextonParams::default() };
    analyse_textons(&MapSet::new(vec![(MapKind::Height, t)]), &params).unwrap().0
}

fn metrics(size: u32, f: impl Fn(u32, u32) -> f32 + Sync) -> SeamMetrics {
    let t = Texture::from_fn(size, size, 1, |x, y, out| out[0] = f(x, y));
    SeamMetrics::new(&MapSet::new(vec![(MapKind::Height, t)]), &AnalysisParams::default()).unwrap()
}

fn facets(m: &crate::mesh::TriMesh, up: Option<crate::numerics::vec::Vec3>, scale: f32) -> Facets {
    let n = m.positions.len();
    let ups = match up {
        Some(up) => vec![up; n],
        None => m.vertex_normals().iter().map(|n| n.any_perpendicular()).collect(),
    };
    Facets::new(m, &Field { up: ups, scale: vec![scale; n] }, Symmetry::One)
}

/// How far what lies on the two sides of an edge is apart in the exemplar, in texels.
fn gap(facets: &Facets, at: &[Vec2], f: usize, k: usize) -> Option<f64> {
    let (g, j) = facets.opposite(f, k)?;
    Some((at[f] + facets.middle(f, k) - at[g] - facets.middle(g, j)).length())
}

fn open_gaps(facets: &Facets, at: &[Vec2]) -> usize {
    let edges = (0..facets.len()).flat_map(|f| (0..3).map(move |k| (f, k)));
    edges.filter(|(f, k)| gap(facets, at, *f, *k).is_some_and(|d| d > seam::SAME)).count() / 2
}

#[test]
fn all_faces_lie_inside_on_any_mesh_for_any_number_of_threads() {
    let (map, metrics) = (textons(48, 1, noise), metrics(48, noise));
    for (name, m) in zoo::all() {
        let facets = facets(&m, None, 6.0);
        for refine in [0, 2] {
            let params = QuiltParams { refine, ..QuiltParams::default() };
            let run = |jobs| par::install(jobs, || quilt(&map, &facets, Some(&metrics), &params));
            let Ok(q) = run(1) else { panic!("{name}: {:?}", run(1)) };
            assert_eq!(Ok(&q), run(3).as_ref(), "{name}");
            for (at, local) in q.at.iter().zip(&facets.local) {
                for c in local {
                    let p = *at + *c;
                    assert!(
                        (0.5 - 1e-9..=47.5 + 1e-9).contains(&p.x) && (0.5 - 1e-9..=47.5 + 1e-9).contains(&p.y),
                        "{name}: {p:?}"
                    );
                }
            }
            assert!(q.counters.seeds >= 1 && q.counters.pieces <= facets.len() as u64, "{name}");
        }
    }
}

#[test]
fn a_plane_smaller_than_the_exemplar_is_mostly_a_piece_of_it() {
    let (map, metrics) = (textons(64, 1, noise), metrics(64, noise));
    let m = zoo::plane(8, 8);
    let facets = facets(&m, Some(vec3(0., 1., 0.)), 4.0);
    for refine in [0, 1] {
        let q = quilt(&map, &facets, Some(&metrics), &QuiltParams { refine, ..QuiltParams::default() }).unwrap();
        let (open, all) = (open_gaps(&facets, &q.at), facets.len() * 3 / 2);
        println!("refine {refine}: {open} of {all} edges are seams; {:?}", q.counters);
        assert!(open * 3 < all, "{open} of {all}");
    }
}

#[test]
fn a_periodic_exemplar_covers_a_plane_without_errors() {
    let sample = |x, y| noise(x % 16, y % 16);
    let (map, metrics) = (textons(64, 1, sample), metrics(64, sample));
    let m = zoo::plane(16, 16);
    let facets = facets(&m, Some(vec3(0., 1., 0.)), 8.0);
    let q = quilt(&map, &facets, Some(&metrics), &QuiltParams { refine: 2, ..QuiltParams::default() }).unwrap();
    // Away from the exemplar's border windows repeat exactly: nearly all gaps are whole periods.
    let off = |d: f64| (d / 16.0 - (d / 16.0).round()).abs() * 16.0;
    let edges = (0..facets.len()).flat_map(|f| (0..3).map(move |k| (f, k)));
    let wrong = edges
        .filter_map(|(f, k)| {
            let (g, j) = facets.opposite(f, k)?;
            let d = q.at[f] + facets.middle(f, k) - q.at[g] - facets.middle(g, j);
            Some(off(d.x) > 0.6 || off(d.y) > 0.6)
        })
        .filter(|w| *w)
        .count();
    println!("{wrong} of {} half-edges off the period; {:?}", facets.len() * 3, q.counters);
    assert!(wrong * 10 < facets.len() * 3, "{wrong}");
}

#[test]
fn another_seed_gives_another_quilt() {
    let map = textons(48, 4, noise);
    let facets = facets(&zoo::torus(12, 8), None, 8.0);
    let run = |seed| quilt(&map, &facets, None, &QuiltParams { seed, ..QuiltParams::default() }).unwrap().at;
    assert_ne!(run(1), run(2));
    assert_eq!(run(3), run(3));
}

#[test]
fn bad_input_gets_a_sentence() {
    let map = textons(32, 1, noise);
    let facets = facets(&zoo::plane(2, 2), Some(vec3(0., 1., 0.)), 40.0);
    let fault = |p: QuiltParams| quilt(&map, &facets, None, &p).unwrap_err().to_string();
    assert_eq!(fault(QuiltParams { candidates: 0, ..QuiltParams::default() }), "candidates = 0: expected 1..=4096");
    assert!(fault(QuiltParams { reach: f64::NAN, ..QuiltParams::default() }).contains("NaN"));
    assert!(fault(QuiltParams::default()).starts_with("face 0 takes 40.0 x 40.0 texels, but an exemplar of 32 x 32"));
}

/// What the texels on both sides of all edges differ by in the mean, as a share of what unrelated ones do.
fn difference(map: &TextonMap, facets: &Facets, at: &[Vec2]) -> f64 {
    let (mut sum, mut count, size) = (0.0, 0.0, [map.width(), map.height()]);
    for (f, k) in (0..facets.len()).flat_map(|f| (0..3).map(move |k| (f, k))) {
        let Some((g, j)) = facets.opposite(f, k) else { continue };
        let ([a, b], [d, c]) = (facets.edge(f, k), facets.edge(g, j));
        for t in [0.125, 0.375, 0.625, 0.875] {
            let here = texel_at(size, at[f] + a + (b - a) * t);
            let there = texel_at(size, at[g] + c + (d - c) * t);
            sum += f64::from(map.points().squared_distance(here, there)).sqrt();
            count += 1.0;
        }
    }
    sum / count / seam::typical_distance(map)
}

/// Figures for the header, by the order of growth.
#[test]
fn growing_in_rounds_by_the_finished_share_is_as_good_as_any_order() {
    let map = textons(96, 1, noise);
    let facets = facets(&zoo::torus(48, 32), None, 16.0);
    let measure = |growth| {
        let params = QuiltParams { refine: 0, ..QuiltParams::default() };
        let q = quilt_in_order(&map, &facets, None, &params, growth).unwrap();
        let (seams, error) = (open_gaps(&facets, &q.at), difference(&map, &facets, &q.at));
        println!("{growth:?}: {seams} seams of {}, difference {error:.4}, {:?}", facets.len() * 3 / 2, q.counters);
        assert_eq!(q.counters.pieces, facets.len() as u64);
        assert!(q.counters.bad_closings * 50 < q.counters.pieces, "{growth:?}");
        error
    };
    let rounds = measure(Growth::Rounds);
    for other in [Growth::Share, Growth::Breadth, Growth::Listed] {
        assert!(rounds < 1.05 * measure(other), "{other:?}");
    }
}

/// Mean continuity error of edges, weighted by length, of a quilt, of random places, and of the best place that each edge
/// alone could have, if its other side stays.
#[test]
fn edges_are_far_better_than_random_and_near_the_best_there_is() {
    use crate::exemplar::TextonFeatures;
    use crate::texture::{Texel, texel};
    use crate::uvset::metric::continuity_error;
    let sample = Texture::from_fn(96, 96, 1, |x, y, out| out[0] = noise(x, y));
    let maps = MapSet::new(vec![(MapKind::Height, sample.clone())]);
    let m = zoo::torus(24, 16);
    let facets = facets(&m, None, 16.0);
    let end = |p: Vec2| -> Texel { texel(p.x as f32, p.y as f32) };
    let edges = || (0..facets.len()).flat_map(|f| (0..3).map(move |k| (f, k)));
    let mean = |at: &dyn Fn(usize) -> Vec2| {
        let (mut sum, mut all) = (0.0, 0.0);
        for (f, k) in edges() {
            let Some((g, j)) = facets.opposite(f, k) else { continue };
            let ([a, b], [d, c]) = (facets.edge(f, k), facets.edge(g, j));
            let error = continuity_error(&sample, [a, b].map(|p| end(at(f) + p)), [c, d].map(|p| end(at(g) + p)));
            let length = (b - a).length();
            (sum, all) = (sum + f64::from(error) * length, all + length);
        }
        sum / all
    };
    let key = Key::new(77);
    let random: Vec<Vec2> =
        (0..facets.len()).map(|f| Inside::new([96, 96], box_of(&facets.local[f])).random(key.with(f as u64))).collect();
    let chance = mean(&|f| random[f]);
    for features in [TextonFeatures::Window, TextonFeatures::FilterBank] {
        let map = analyse_textons(&maps, &TextonParams { features, ..TextonParams::default() }).unwrap().0;
        let metrics = SeamMetrics::new(&maps, &AnalysisParams::default()).unwrap();
        for refine in [0, 2] {
            let q = quilt(&map, &facets, Some(&metrics), &QuiltParams { refine, ..QuiltParams::default() }).unwrap();
            let found = mean(&|f| q.at[f]);
            // Of every seventh edge: the least error that some whole shift of the face beyond would give.
            let (mut best, mut count) = (0.0, 0);
            for (f, k) in edges().step_by(7).take(60) {
                let Some((g, j)) = facets.opposite(f, k) else { continue };
                let ([a, b], [d, c]) = (facets.edge(f, k), facets.edge(g, j));
                let ours = [a, b].map(|p| end(q.at[f] + p));
                let inside = Inside::new([96, 96], box_of(&facets.local[g]));
                let there = q.at[f] + (a + b) * 0.5 - (c + d) * 0.5;
                let shifts = (-95..=95).flat_map(|y| (-95..=95).map(move |x| there + vec2(f64::from(x), f64::from(y))));
                let error = |at: Vec2| continuity_error(&sample, ours, [c, d].map(|p| end(at + p)));
                best += f64::from(shifts.filter(|at| inside.contains(*at)).map(error).fold(f32::INFINITY, f32::min));
                count += 1;
            }
            let best = best / f64::from(count);
            println!("{features:?}, refine {refine}: {found:.4}; random {chance:.4}, best possible {best:.4}");
            assert!(found < 0.35 * chance, "{found} against {chance}");
        }
    }
}
