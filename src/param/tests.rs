//! Coordinates on surfaces of which they are known by theory, and on real ones.

use super::*;
use crate::field::{self, OrientationConstraint};
use crate::mesh::zoo;
use crate::numerics::vec::{vec2, vec3};

/// A mesh and what a parametrisation of it needs.
pub(super) struct Laid {
    pub mesh: TriMesh,
    pub topo: Topology,
    pub normals: Vec<Vec3>,
    pub field: Field,
    pub symmetry: Symmetry,
}

impl Laid {
    /// With the default field, or one from anchors, of some texels per unit.
    pub fn new(mesh: TriMesh, anchors: &[OrientationConstraint], symmetry: Symmetry, scale: f32) -> Self {
        let (topo, normals) = (Topology::new(&mesh), mesh.vertex_normals());
        let up = field::orientation(&mesh, &topo, &normals, anchors, &[], &[], symmetry).unwrap();
        let scale = vec![scale; up.len()];
        Laid { mesh, topo, normals, field: Field { up, scale }, symmetry }
    }

    pub fn parametrize(&self, tile: [u32; 2]) -> Parametrization {
        parametrize(&self.mesh, &self.topo, &self.normals, &self.field, self.symmetry, tile).unwrap()
    }
}

/// Shares of faces that are distorted, around which coordinates wind, and that are shown by three look-ups.
pub(super) fn shares(mesh: &TriMesh, p: &Parametrization) -> [f64; 3] {
    let n = mesh.faces.len();
    let share = |count: usize| count as f64 / n as f64;
    [
        share(p.faults.iter().filter(|f| f.distorted).count()),
        share(p.faults.iter().filter(|f| !f.around.closes()).count()),
        share((0..n).filter(|&f| p.look_ups(mesh, f) == 3).count()),
    ]
}

/// Coordinates that are linear in the position, whatever whole periods lie between the faces.
#[test]
fn a_flat_grid_with_a_constant_field_is_linear() {
    let up = vec3(0.6, 0.8, 0.0);
    for symmetry in [Symmetry::One, Symmetry::Two, Symmetry::Four] {
        let anchor = OrientationConstraint { at: vec3(10., 10., 0.), up, radius: None };
        let mut l = Laid::new(zoo::plane(20, 15), &[anchor], symmetry, 10.0);
        let turned = [up, vec3(-0.8, 0.6, 0.0), -up, vec3(0.8, -0.6, 0.0)];
        let ways = symmetry.directions() as usize;
        (0..l.field.up.len()).for_each(|v| l.field.up[v] = turned[v * 5 % ways * (4 / ways)]);
        let tile = if symmetry == Symmetry::Four { [64, 64] } else { [64, 32] };
        let p = l.parametrize(tile);
        assert_eq!(shares(&l.mesh, &p), [0.0; 3], "{symmetry:?}");
        for (f, at) in p.corners.iter().enumerate() {
            let x = l.mesh.corners(f);
            let [s, t] = [vec2(0.8, -0.6), up_down(up)].map(|d| vec2(d.x, d.y));
            for k in 1..3 {
                let e = x[k] - x[0];
                let want = vec2(
                    (e.x * s.x + e.y * s.y) * 10.0 / f64::from(tile[0]),
                    (e.x * t.x + e.y * t.y) * 10.0 / f64::from(tile[1]),
                );
                let first = l.mesh.faces[f][0] as usize;
                let frame = (first * 5 % ways * (4 / ways)) as u8;
                let got = guide::from_turned(at[k] - at[0], frame);
                assert!((got - want).length() < 1e-4, "{symmetry:?} face {f}: {got:?} for {want:?}");
            }
        }
    }
}

fn up_down(up: Vec3) -> crate::numerics::vec::Vec2 {
    vec2(-up.x, -up.y)
}

#[test]
fn a_torus_with_a_field_along_it_has_no_singularity() {
    let mut l = Laid::new(zoo::torus(120, 60), &[], Symmetry::One, 1.0);
    for (v, p) in l.mesh.positions.iter().enumerate() {
        let out = vec3(p.x, p.y, 0.0);
        l.field.up[v] = vec3(-p.y, p.x, 0.0).reject(l.normals[v]).normalized().unwrap();
        // As many periods around the hole at any distance from it.
        l.field.scale[v] = (64.0 * 16.0 / std::f64::consts::TAU / out.length()) as f32;
    }
    let p = l.parametrize([64, 64]);
    assert_eq!(shares(&l.mesh, &p), [0.0; 3]);
    assert!(p.sets(&l.mesh, &vec![0.0; l.normals.len()]).unwrap().sets.len() == 1);
}

#[test]
fn a_sphere_has_poles_where_its_field_has_them_and_indices_sum_to_two() {
    for symmetry in [Symmetry::One, Symmetry::Two, Symmetry::Four] {
        let l = Laid::new(zoo::icosphere(5), &[], symmetry, 200.0);
        let p = l.parametrize([64, 64]);
        let found = field::singularities(&l.mesh, &l.topo, &l.normals, &l.field.up, symmetry);
        assert_eq!(found.iter().map(|f| f.1).sum::<f64>(), 2.0);
        let faces: Vec<u32> = found.iter().map(|f| f.0).collect();
        let places = singular_places(&l.mesh, &l.topo, &p.faults, &faces);
        assert!(places.iter().any(|s| s.kind == Kind::Pole));
        // Every singularity of the field lies in or beside a face at fault.
        for f in faces {
            let rings = l.mesh.faces[f as usize].iter().flat_map(|&v| l.topo.faces(v));
            assert!(rings.into_iter().any(|&g| !p.faults[g as usize].none()), "{symmetry:?}");
        }
        // All that winds anywhere winds around nothing in all, where there is one frame: a closed surface has no border.
        if symmetry == Symmetry::One {
            let sum = |k: usize| p.faults.iter().map(|f| f.around.periods[k]).sum::<i32>();
            assert_eq!([sum(0), sum(1)], [0, 0]);
        }
    }
}

/// The three look-ups of a face agree with those of its neighbours along their common edge, up to whole periods.
#[test]
fn what_is_shown_is_continuous_across_every_edge() {
    let l = Laid::new(zoo::icosphere(4), &[], Symmetry::One, 150.0);
    let p = l.parametrize([64, 64]);
    let sets = p.sets(&l.mesh, &vec![0.25; l.normals.len()]).unwrap();
    assert_eq!((sets.sets.len(), sets.material[7]), (3, 0.25));
    // (weight, place in the tile) of each set that counts at an end of an edge.
    let shown = |f: usize, k: usize, corner: usize| -> Vec<(f32, [f32; 2])> {
        let c = 3 * f + k;
        let one = |s: usize| {
            // At a point a little way along the edge, both ends weigh.
            let (a, b) = (sets.sets[s][c], sets.sets[s][3 * f + corner]);
            let wrap = |x: f32| x - (x / 64.0).floor() * 64.0;
            let w = sets.weights[c][s] * 0.75 + sets.weights[3 * f + corner][s] * 0.25;
            (w, [wrap(a.x * 0.75 + b.x * 0.25), wrap(a.y * 0.75 + b.y * 0.25)])
        };
        (0..3).map(one).filter(|o| o.0 > 0.0).collect()
    };
    let mut compared = 0;
    for (f, face) in l.mesh.faces.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            let across = l.topo.faces(a).iter().find(|&&g| g as usize != f && l.mesh.faces[g as usize].contains(&b));
            let g = *across.expect("a closed surface") as usize;
            let place = |v: u32| l.mesh.faces[g].iter().position(|&u| u == v).expect("shared");
            let (here, there) = (shown(f, k, (k + 1) % 3), shown(g, place(a), place(b)));
            let near = |p: [f32; 2], q: [f32; 2]| {
                (0..2).all(|i| {
                    let d = (p[i] - q[i]).abs();
                    d.min(64.0 - d) < 0.05
                })
            };
            for (_, p) in &here {
                let weight = |of: &[(f32, [f32; 2])]| -> f32 { of.iter().filter(|o| near(o.1, *p)).map(|o| o.0).sum() };
                assert!((weight(&here) - weight(&there)).abs() < 1e-5, "{here:?} {there:?}");
                compared += 1;
            }
        }
    }
    assert!(compared > 3 * l.mesh.faces.len(), "some edges have two");
}

#[test]
fn every_mesh_of_the_zoo_gets_finite_coordinates() {
    for (name, mut mesh) in zoo::all() {
        // A vertex that no face uses.
        mesh.positions.push(vec3(0.1, 0.2, 0.3));
        for symmetry in [Symmetry::One, Symmetry::Four] {
            let l = Laid::new(mesh.clone(), &[], symmetry, 40.0);
            let p = l.parametrize([64, 64]);
            let sets = p.sets(&l.mesh, &vec![0.0; l.normals.len()]).unwrap();
            let finite = sets.sets.iter().flatten().all(|t| t.x.is_finite() && t.y.is_finite());
            assert!(finite && p.corners.iter().flatten().all(|c| c.length().is_finite()), "{name}");
            assert!(sets.weights.iter().all(|w| w.iter().sum::<f32>() == 1.0), "{name}");
        }
    }
}

#[test]
fn the_bound_has_no_unit_and_threads_no_say() {
    let l = Laid::new(zoo::icosphere(4), &[], Symmetry::One, 120.0);
    let p = l.parametrize([64, 64]);
    let mut large = Laid::new(zoo::icosphere(4), &[], Symmetry::One, 0.1171875);
    large.mesh.positions.iter_mut().for_each(|p| *p = *p * 1024.0);
    assert_eq!(large.parametrize([64, 64]).faults, p.faults, "a thousand times as large");
    let run = |jobs| par::install(jobs, || l.parametrize([64, 64]));
    assert_eq!(run(1), run(3));
}

#[test]
fn an_effect_area_leaves_the_rest_bit_for_bit() {
    let mesh = zoo::icosphere(4);
    let base = Laid::new(mesh.clone(), &[], Symmetry::One, 120.0);
    let p = base.parametrize([64, 64]);
    let constraint = |x: f64, up: Vec3| OrientationConstraint { at: vec3(x, 0., 0.), up, radius: Some(0.8) };
    let (near, far) = (constraint(1.0, vec3(0., 0.3, 1.)), constraint(-1.0, vec3(0., -0.5, 1.)));
    let follow = |anchors: &[OrientationConstraint]| {
        let l = Laid::new(mesh.clone(), anchors, Symmetry::One, 120.0);
        let change = change_of(&base, &p, &l.field);
        assert!(change.phases.len() > 50 && change.phases.len() < mesh.positions.len() / 2);
        let mut q = p.clone();
        q.apply(&change).unwrap();
        q
    };
    let (one, both) = (follow(&[near]), follow(&[near, far]));
    let material = vec![0.0; base.normals.len()];
    let sets = |q: &Parametrization| q.sets(&mesh, &material).unwrap();
    let (before, one_sets, both_sets) = (sets(&p), sets(&one), sets(&both));
    let mut changed = 0;
    for f in 0..mesh.faces.len() {
        let x = mesh.corners(f).map(|c| c.x);
        let same = |a: &UvSetsRef, b: &UvSetsRef| (0..3).all(|k| shown(a, 3 * f + k) == shown(b, 3 * f + k));
        // Geodesic distances along edges are larger than straight ones.
        if x.iter().all(|x| *x < 0.6) {
            assert!(same(&before, &one_sets), "face {f} outside of the area");
        }
        if x.iter().all(|x| *x > -0.6) {
            assert!(same(&one_sets, &both_sets), "face {f} outside of the other area");
        }
        changed += usize::from(!same(&before, &one_sets));
    }
    assert!(changed > 100, "{changed}");
    assert_eq!(change_of(&base, &p, &base.field), Change::default());
    // Two areas at once are what each is for itself, and all that is derived is as if derived from all.
    let apart = |q: &mut Parametrization, anchor| {
        let l = Laid::new(mesh.clone(), &[anchor], Symmetry::One, 120.0);
        q.apply(&change_of(&base, &p, &l.field)).unwrap();
    };
    let mut q = p.clone();
    apart(&mut q, near);
    apart(&mut q, far);
    assert_eq!(q, both);
    for (q, l) in [(&p, &base), (&both, &Laid::new(mesh.clone(), &[near, far], Symmetry::One, 120.0))] {
        let is_invalid = |v: u32| l.topo.faces(v).iter().any(|&f| !q.faults[f as usize].none());
        assert!((0..).zip(&q.invalid).all(|(v, invalid)| is_invalid(v) == *invalid));
        let wanted = Wanted {
            mesh: &mesh,
            topo: &l.topo,
            normals: &l.normals,
            field: &l.field,
            symmetry: Symmetry::One,
            tile: [64, 64],
        };
        let guide = wanted.guide();
        let centres = (0..q.invalid.len() as u32).filter(|v| q.invalid[*v as usize]);
        let steps: Vec<Step> = centres.flat_map(|v| steps_around(&l.topo, v, &guide.steps)).collect();
        let own = |s: &Step| l.field.up[s.from as usize] != base.field.up[s.from as usize];
        // Where an edge of two locked vertices is at a face with an open one, the step is the one it was.
        assert_eq!(q.steps.len(), steps.len());
        assert!(q.steps.iter().zip(&steps).all(|(a, b)| (a.from, a.to) == (b.from, b.to) && (!own(a) || a == b)));
    }
}

type UvSetsRef = crate::uvset::UvSets;

fn shown(sets: &UvSetsRef, corner: usize) -> Vec<(f32, [u32; 2])> {
    let one = |s: usize| {
        let at = sets.sets[s][corner];
        (sets.weights[corner][s], [at.x.to_bits(), at.y.to_bits()])
    };
    (0..sets.sets.len()).map(one).filter(|o| o.0 > 0.0).collect()
}

fn change_of(base: &Laid, p: &Parametrization, field: &Field) -> Change {
    let locked = Locked { tile: p.tile, phases: &p.phases, faults: &p.faults };
    follow(&locked, &base.mesh, &base.normals, [&base.field, field], Symmetry::One).unwrap()
}

#[test]
fn what_cannot_be_parametrised_is_named() {
    let l = Laid::new(zoo::plane(3, 3), &[], Symmetry::Four, 10.0);
    let run = |field: &Field, tile| parametrize(&l.mesh, &l.topo, &l.normals, field, l.symmetry, tile).unwrap_err();
    assert!(run(&l.field, [64, 32]).to_string().contains("cannot be turned by a quarter"));
    assert_eq!(run(&l.field, [0, 64]), Error::Tile([0, 64]));
    for scale in [0.0, -1.0, f32::NAN, 1e-40] {
        let mut field = l.field.clone();
        field.scale[5] = scale;
        assert!(run(&field, [64, 64]).to_string().starts_with("the scale at vertex 5 is"));
    }
    let mut field = l.field.clone();
    field.up[2] = Vec3::ZERO;
    assert_eq!(run(&field, [64, 64]), Error::Direction { vertex: 2 });
}

/// The paper has 5 to 10 % of triangles beyond the bound.
#[test]
fn real_meshes_are_hardly_distorted_and_finite() {
    for (name, most) in [("cheburashka", 0.08), ("stanford-bunny", 0.04)] {
        let Some(mesh) = glb(name) else { continue };
        let (low, high) = mesh.bounds();
        let l = Laid::new(mesh, &[], Symmetry::One, (64.0 * 20.0 / (high - low).length()) as f32);
        let p = l.parametrize([64, 64]);
        let [distorted, winding, three] = shares(&l.mesh, &p);
        println!("{name}: distorted {distorted:.3}, winding {winding:.4}, three look-ups {three:.3}");
        assert!(p.corners.iter().flatten().all(|c| c.length().is_finite()), "{name}");
        assert!(distorted < most, "{name}: {distorted}");
    }
}

/// A mesh of `../shared/data/meshes/glb`, prepared as a bake would, without subdividing.
pub(super) fn glb(name: &str) -> Option<TriMesh> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/meshes/glb");
    let path = path.join(format!("{name}.glb"));
    let Ok(bytes) = std::fs::read(&path) else {
        println!("skipped: no {}", path.display());
        return None;
    };
    let document = crate::io::scene::Document::parse(name, &bytes, &mut |_| Err("none".into())).unwrap();
    let surface = document.surface(None).unwrap();
    let params = crate::mesh::PrepareParams::new(f64::MIN_POSITIVE, [1024, 1024]);
    Some(crate::mesh::prepare(&surface, &params).unwrap().mesh)
}
