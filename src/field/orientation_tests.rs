//! Orientation fields on the zoo of meshes and on shapes whose fields are known.

use super::singularities as indices;
use super::*;
use crate::mesh::{Topology, TriMesh, zoo};
use crate::numerics::vec::vec3;
use crate::numerics::{det, par};

#[test]
fn areas_leave_the_rest_and_follow_their_anchor() {
    let m = zoo::icosphere(4);
    let (topo, normals) = (Topology::new(&m), m.vertex_normals());
    for symmetry in [Symmetry::One, Symmetry::Two, Symmetry::Four] {
        let up = default(&m, symmetry);
        let anchor = OrientationConstraint { at: vec3(1., 0., 0.), up: vec3(0., 1., 1.), radius: Some(0.8) };
        let ground = (&m, &topo, &normals[..]);
        let laid = orientation_in_areas(ground, &up, &[anchor], &[], &[], symmetry).unwrap();
        let far = |v: usize| (m.positions[v] - vec3(1., 0., 0.)).length() > 0.8;
        assert!((0..up.len()).all(|v| !far(v) || up[v] == laid[v]), "{symmetry:?}");
        let at = (0..up.len()).max_by(|&a, &b| m.positions[a].x.total_cmp(&m.positions[b].x)).unwrap();
        let wanted = vec3(0., 1., 1.).normalized().unwrap();
        let along = laid[at].dot(wanted).abs().max(laid[at].cross(normals[at]).dot(wanted).abs());
        assert!(along > 0.999, "{symmetry:?} {:?}", laid[at]);
        let none = OrientationConstraint { radius: None, ..anchor };
        assert_eq!(orientation_in_areas(ground, &up, &[none], &[], &[], symmetry).unwrap(), up);
    }
}

fn default(m: &TriMesh, symmetry: Symmetry) -> Vec<Vec3> {
    orientation(m, &Topology::new(m), &m.vertex_normals(), &[], &[], &[], symmetry).unwrap()
}

fn anchor(at: Vec3, up: Vec3, radius: Option<f64>) -> OrientationConstraint {
    OrientationConstraint { at, up, radius }
}

fn is_field(m: &TriMesh, up: &[Vec3]) -> bool {
    let normals = m.vertex_normals();
    let ok = |(u, n): (&Vec3, &Vec3)| (u.length() - 1.0).abs() < 1e-12 && u.dot(*n).abs() < 1e-12;
    up.len() == m.positions.len() && up.iter().zip(&normals).all(ok)
}

/// A tube about the y axis, open at both ends.
fn tube() -> TriMesh {
    let (n, h) = (24u32, 10u32);
    let at = |i: u32, j: u32| j * n + i % n;
    let point = |k: u32| {
        let (s, c) = det::sin_cos(std::f64::consts::TAU * f64::from(k % n) / f64::from(n));
        vec3(c, f64::from(k / n) * 0.3, s)
    };
    let quad = |k: u32| {
        let (i, j) = (k % n, k / n);
        [[at(i, j), at(i, j + 1), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i + 1, j)]]
    };
    TriMesh { positions: (0..n * (h + 1)).map(point).collect(), faces: (0..n * h).flat_map(quad).collect() }
}

#[test]
fn the_zoo_gets_unit_tangents() {
    for (name, m) in zoo::all() {
        for symmetry in [Symmetry::One, Symmetry::Two, Symmetry::Four, Symmetry::Isotropic] {
            assert!(is_field(&m, &default(&m, symmetry)), "{name} {symmetry:?}");
            let topo = Topology::new(&m);
            let c = anchor(m.positions[0], vec3(0.3, 0.2, 0.5), None);
            let s = SingularityConstraint { at: m.positions[1], kind: SingularityKind::Source, radius: Some(0.5) };
            let up = orientation(&m, &topo, &m.vertex_normals(), &[c], &[s], &[], symmetry).unwrap();
            assert!(is_field(&m, &up), "{name} {symmetry:?} anchored");
        }
    }
}

#[test]
fn by_default_walls_are_level_and_floors_continue_the_front() {
    let m = tube();
    assert!(m.area_vector(0).dot(m.corners(0)[0]) > 0.0);
    assert!(default(&m, Symmetry::One).iter().all(|u| u.y > 1.0 - 1e-6), "bricks on a tube lie level");
    let turned = |f: fn(Vec3) -> Vec3| {
        let mut m = zoo::plane(4, 4);
        m.positions.iter_mut().for_each(|p| *p = f(*p));
        default(&m, Symmetry::One)
    };
    let near = |ups: Vec<Vec3>, want: Vec3| ups.iter().all(|u| (*u - want).length() < 1e-6);
    assert!(near(turned(|p| p), vec3(0., 1., 0.)), "the front");
    assert!(near(turned(|p| vec3(p.x, 0., -p.y)), vec3(0., 0., -1.)), "a floor");
    assert!(near(turned(|p| vec3(p.x, 0., p.y)), vec3(0., 0., 1.)), "a ceiling");
}

#[test]
fn an_anchor_alone_rules_a_plane() {
    let m = zoo::plane(30, 20);
    let want = vec3(3., -4., 0.) / 5.0;
    let c = anchor(vec3(7., 5., 2.), want * 3.0 + vec3(0., 0., 1.), None);
    let up = orientation(&m, &Topology::new(&m), &m.vertex_normals(), &[c], &[], &[], Symmetry::One).unwrap();
    assert!(up.iter().all(|u| (*u - want).length() < 1e-4));
}

#[test]
fn a_radius_leaves_the_rest_as_it_was() {
    let m = zoo::plane(30, 20);
    let topo = Topology::new(&m);
    let c = anchor(vec3(7., 5., 0.), vec3(1., 0., 0.), Some(4.0));
    let without = default(&m, Symmetry::One);
    let up = orientation(&m, &topo, &m.vertex_normals(), &[c], &[], &[], Symmetry::One).unwrap();
    assert!((up[5 * 31 + 7] - vec3(1., 0., 0.)).length() < 1e-9);
    let bent = up[5 * 31 + 9];
    assert!(bent.x > 0.1 && bent.y > 0.1, "between the two: {bent:?}");
    for (v, p) in m.positions.iter().enumerate() {
        assert!((*p - vec3(7., 5., 0.)).length() <= 4.0 || up[v] == without[v], "{v}");
    }
}

#[test]
fn sources_sinks_and_vortices_do_as_they_are_told() {
    let m = zoo::plane(20, 20);
    let topo = Topology::new(&m);
    let at = vec3(10., 10., 0.);
    let run = |kind| {
        let s = SingularityConstraint { at, kind, radius: None };
        orientation(&m, &topo, &m.vertex_normals(), &[], &[s], &[], Symmetry::One)
    };
    for (kind, quarter) in [(SingularityKind::Source, 0), (SingularityKind::Sink, 2), (SingularityKind::Vortex, 1)] {
        let up = run(kind).unwrap();
        for p in [(11usize, 10usize), (14, 12), (3, 9), (10, 4)] {
            let away = (vec3(p.0 as f64, p.1 as f64, 0.) - at).normalized().unwrap();
            let want = (0..quarter).fold(away, |v, _| vec3(-v.y, v.x, 0.));
            assert!(up[p.1 * 21 + p.0].dot(want) > 0.95, "{kind:?} at {p:?}: {:?}", up[p.1 * 21 + p.0]);
        }
        let total: f64 = indices(&m, &topo, &m.vertex_normals(), &up, Symmetry::One).iter().map(|s| s.1).sum();
        assert_eq!(total, 1.0, "{kind:?}");
    }
    let e = run(SingularityKind::Index(0.5)).unwrap_err();
    assert!(e.to_string().contains("multiple of 1/1"), "{e}");
}

#[test]
fn contradictions_are_named() {
    let m = zoo::plane(10, 10);
    let (topo, normals) = (Topology::new(&m), m.vertex_normals());
    let (p, right, up) = (vec3(5., 5., 0.), vec3(1., 0., 0.), vec3(0., 1., 0.));
    let run = |a: &[OrientationConstraint], s: &[SingularityConstraint], symmetry| {
        orientation(&m, &topo, &normals, a, s, &[], symmetry)
    };
    let text = run(&[anchor(p, right, None), anchor(p, up, None)], &[], Symmetry::One).unwrap_err().to_string();
    assert!(text.starts_with("orientation constraint 0 and orientation constraint 1 contradict"), "{text}");
    assert!(run(&[anchor(p, up, None), anchor(p, -up, None)], &[], Symmetry::Two).is_ok(), "the same, half a turn on");
    assert!(run(&[anchor(p, up, None), anchor(p, right, None)], &[], Symmetry::Four).is_ok());
    assert!(run(&[anchor(p, right, None), anchor(p, up, Some(2.0))], &[], Symmetry::One).is_ok(), "nearby another");
    let s = SingularityConstraint { at: p, kind: SingularityKind::Sink, radius: None };
    assert!(matches!(run(&[anchor(p, up, None)], &[s], Symmetry::One), Err(Error::Contradiction { .. })));
    assert!(matches!(run(&[], &[s, s], Symmetry::One), Err(Error::Contradiction { .. })));
}

#[test]
fn without_a_preferred_direction_nothing_is_solved_but_wishes_are_checked() {
    let m = zoo::icosphere(3);
    let (topo, normals) = (Topology::new(&m), m.vertex_normals());
    let run = |a: &[OrientationConstraint]| orientation(&m, &topo, &normals, a, &[], &[], Symmetry::Isotropic);
    let plain = run(&[]).unwrap();
    assert!(is_field(&m, &plain));
    assert_eq!(run(&[anchor(vec3(1., 0., 0.), vec3(0., 0., 1.), None)]).unwrap(), plain);
    assert!(run(&[anchor(vec3(1., 0., 0.), Vec3::ZERO, None)]).is_err());
    let level = |(p, u): (&Vec3, &Vec3)| p.y.abs() > 0.3 || u.y > 0.9;
    assert!(m.positions.iter().zip(&plain).all(level), "up around the equator");
}

#[test]
fn bad_anchors_are_named() {
    let m = zoo::plane(2, 2);
    let fail = |at, up| {
        let a = [anchor(vec3(0., 0., 0.), vec3(0., 1., 0.), None), anchor(at, up, None)];
        orientation(&m, &Topology::new(&m), &m.vertex_normals(), &a, &[], &[], Symmetry::One).unwrap_err().to_string()
    };
    let zero = Vec3::ZERO;
    assert_eq!(fail(zero, zero), "orientation constraint 1: up is the zero vector; it must have a direction");
    assert!(fail(zero, vec3(0., 0., -7.)).contains("straight out of the surface"));
    assert!(fail(zero, vec3(f64::NAN, 0., 0.)).contains("NaN"));
    assert!(fail(vec3(0., 0., 50.), vec3(1., 0., 0.)).contains("is 50 units from the surface"));
    let c = anchor(zero, vec3(1e-200, 0., 0.), None);
    assert!(orientation(&m, &Topology::new(&m), &m.vertex_normals(), &[c], &[], &[], Symmetry::One).is_ok());
}

#[test]
fn turning_mesh_and_anchors_turns_the_field() {
    // A fixed rotation of (1, 2, 2)/3 by a right angle and a bit: columns from Rodrigues' formula.
    let (s, c) = det::sin_cos(1.9);
    let k = vec3(1. / 3., 2. / 3., 2. / 3.);
    let turn = |v: Vec3| v * c + k.cross(v) * s + k * (k.dot(v) * (1.0 - c));
    let mut m = zoo::torus(40, 20);
    let anchors = [(0, vec3(0., 0., 1.)), (400, vec3(0., 1., 1.)), (790, vec3(1., 0., 0.3))];
    let run = |m: &TriMesh, f: &dyn Fn(Vec3) -> Vec3| {
        let a: Vec<_> = anchors.iter().map(|&(v, up)| anchor(m.positions[v], f(up), None)).collect();
        orientation(m, &Topology::new(m), &m.vertex_normals(), &a, &[], &[], Symmetry::One).unwrap()
    };
    let before = run(&m, &|v| v);
    m.positions.iter_mut().for_each(|p| *p = turn(*p));
    let after = run(&m, &turn);
    let worst = before.iter().zip(&after).map(|(a, b)| (turn(*a) - *b).length()).fold(0.0, f64::max);
    assert!(worst < 1e-3, "{worst}");
}

#[test]
fn naming_the_vertices_otherwise_changes_nothing() {
    let m = zoo::icosphere(3);
    let n = m.positions.len();
    let to = |v: usize| (v * 5 + 3) % n; // 642 and 5 have no common divisor
    let mut other = m.clone();
    (0..n).for_each(|v| other.positions[to(v)] = m.positions[v]);
    other.faces = m.faces.iter().rev().map(|f| f.map(|v| to(v as usize) as u32)).collect();
    let (a, b) = (default(&m, Symmetry::One), default(&other, Symmetry::One));
    let worst = (0..n).map(|v| (a[v] - b[to(v)]).length()).fold(0.0, f64::max);
    assert!(worst < 1e-5, "{worst}");
}

#[test]
fn the_same_bytes_on_any_number_of_threads() {
    let m = zoo::icosphere(5);
    let run = |jobs| par::install(jobs, || default(&m, Symmetry::Four));
    assert!(run(1) == run(2) && run(1) == run(8));
}
