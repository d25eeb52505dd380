//! Orientation: "up" of the sample in the tangent plane of every vertex, relaxed from a few anchors.
//!
//! Source: `[ZG03]` section 3: "The user typically supplies a few anchor vectors at key points of the vector field, and
//! these anchors are relaxed over the mesh", sinks and sources likewise. The relaxation is the linear one of Knöppel et
//! al. 2013 (Globally Optimal Direction Fields): the n-th power of a direction, as a complex number, is what n-fold
//! symmetry leaves of it, and the smoothest such numbers are one sparse solve (`relax`).
//!
//! Where nobody says anything, up is what an artist expects: world +Y on walls, so that courses of bricks lie level.
//! Floors and ceilings, which +Y does not reach, continue the side that faces +Z (glTF's front): up is -Z on floors
//! seen from above, +Z on ceilings. Both are pulls, each as strong as its direction lies in the surface, against
//! smoothness over a tenth of the component's size; so poles are calm and slopes lean. A component with an anchor that
//! has no radius follows its anchors alone, and the default only where their influence has died away.
//! Unaware of: textures, scale.

use super::relax::{Coupling, Guide, Pin, cotangent_weights, disc, relax};
use super::tangent::{Frame, frames, transports};
use super::{Error, Symmetry, Which, site};
use crate::mesh::{Topology, TriMesh, check};
use crate::numerics::csr::{Complex, complex};
use crate::numerics::vec::{Vec3, vec3};
use crate::numerics::{det, par};

/// The default pulls against smoothness over this part of the component's diagonal.
const GUIDE_LENGTH: f64 = 0.1;
/// Weight of the default under anchors, per area, in inverse squared diagonals: bends a flat field by at most about
/// this many radians, and rules where anchors' influence is weaker than it.
const GUIDE_UNDER_ANCHORS: f64 = 1e-5;
/// `up` must leave the normal by at least this (sine of the angle).
const LEAST_TANGENT: f64 = 1e-3;

/// An anchor: "up" of the sample at a point of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientationConstraint {
    /// Acts at the point of the surface nearest to this.
    pub at: Vec3,
    /// Up there, of any length; its tangential part counts.
    pub up: Vec3,
    /// Acts only within this geodesic distance (along edges), in world units; `None`: on the whole component.
    pub radius: Option<f64>,
}

/// What the field does around a singular point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SingularityKind {
    /// Up points away from it.
    Source,
    /// Up points towards it.
    Sink,
    /// Up runs around it, counter-clockwise seen from outside.
    Vortex,
    /// A singularity of this index: not supported yet.
    Index(f64),
}

/// A singular point of the field: holds a small disc around a vertex (at least its 1-ring), not the vertex itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SingularityConstraint {
    /// Sits at the point of the surface nearest to this.
    pub at: Vec3,
    /// What the field does around it.
    pub kind: SingularityKind,
    /// Acts only within this geodesic distance (along edges), in world units; `None`: on the whole component.
    pub radius: Option<f64>,
}

/// The orientation field: a unit vector per vertex, perpendicular to its normal.
///
/// `normals` are the unit normals of the vertices. Where constraints meet, singularities give way to anchors and
/// earlier ones to later ones; those with radius come after all without. For n-fold symmetry each vector is one of n
/// equivalent ones, that nearest to the default. Panics if `normals` or `topo` are not the mesh's.
pub fn orientation(
    mesh: &TriMesh,
    topo: &Topology,
    normals: &[Vec3],
    anchors: &[OrientationConstraint],
    singularities: &[SingularityConstraint],
    symmetry: Symmetry,
) -> Result<Vec<Vec3>, Error> {
    assert_eq!((normals.len(), topo.vertex_count()), (mesh.positions.len(), mesh.positions.len()));
    let n = symmetry.directions();
    let frames = frames(normals);
    let carry = transports(mesh, topo, normals, &frames);
    let coupling =
        Coupling { weights: cotangent_weights(mesh, topo), transport: par::map(carry.len(), |h| carry[h].power(n)) };
    let sites = sites(mesh, anchors, singularities)?;
    let mut pins = vec![];
    let rings = singularities.iter().zip(&sites);
    for (i, (s, site)) in rings.enumerate() {
        pins.push(ring(mesh, topo, normals, &frames, n, Which { list: "singularity", index: i }, s, site)?);
    }
    for (i, (a, site)) in anchors.iter().zip(&sites[singularities.len()..]).enumerate() {
        let which = Which { list: "orientation", index: i };
        let up = tangential(which, a.up, normals[site.vertex as usize])?;
        pins.push(disc(mesh, topo, &coupling, site, frames[site.vertex as usize].complex(up).power(n)));
    }

    let defaults = par::map(normals.len(), |v| default_up(normals[v]));
    let weights = guide_weights(mesh, topo, &pins);
    let guide = |which: usize| {
        par::map(normals.len(), |v| {
            let pull = defaults[v].iter().map(|&(w, t)| power_of(&frames[v], t, n) * w);
            let w = weights[v][which];
            let total = defaults[v].iter().map(|d| d.0).sum::<f64>();
            Guide { weight: total * w, pull: pull.fold(Complex::ZERO, |s, p| s + p) * w }
        })
    };
    let guides = [guide(0), guide(1)];
    let mut z = vec![Complex::ZERO; normals.len()];
    relax(mesh, topo, &coupling, &pins, &vec![true; normals.len()], [&guides[0], &guides[1]], &mut z);
    Ok(par::map(normals.len(), |v| {
        // Where smoothness cancels all: the default, or any direction.
        let power = z[v].unit().or(guides[0][v].pull.unit()).unwrap_or(Complex::ONE);
        let preferred = defaults[v].iter().fold(Vec3::ZERO, |s, &(w, t)| s + t * w);
        let up = frames[v].vector(root(power, n, frames[v].complex(preferred)));
        up.normalized().unwrap_or(up)
    }))
}

/// Sites of the singularities, then of the anchors.
fn sites(
    mesh: &TriMesh,
    anchors: &[OrientationConstraint],
    singularities: &[SingularityConstraint],
) -> Result<Vec<site::Site>, Error> {
    let rings =
        singularities.iter().enumerate().map(|(index, s)| (Which { list: "singularity", index }, s.at, s.radius));
    let points = anchors.iter().enumerate().map(|(index, a)| (Which { list: "orientation", index }, a.at, a.radius));
    let wanted: Vec<_> = rings.chain(points).collect();
    if wanted.is_empty() {
        return Ok(vec![]);
    }
    site::sites(mesh, &wanted)
}

/// The unit tangential part of an anchor's vector.
fn tangential(which: Which, up: Vec3, normal: Vec3) -> Result<Vec3, Error> {
    if !up.is_finite() {
        return Err(Error::NotFinite(which));
    }
    let largest = up.x.abs().max(up.y.abs()).max(up.z.abs());
    let unit = (up / largest).normalized().ok_or(Error::UpIsZero(which))?;
    let part = unit.reject(normal);
    if part.length() < LEAST_TANGENT {
        return Err(Error::UpIsNormal { which, up, normal });
    }
    part.normalized().ok_or(Error::UpIsNormal { which, up, normal })
}

/// What lies around a singularity (its disc, at least its 1-ring), held at what its kind says.
#[allow(clippy::too_many_arguments)]
fn ring(
    mesh: &TriMesh,
    topo: &Topology,
    normals: &[Vec3],
    frames: &[Frame],
    n: u32,
    which: Which,
    s: &SingularityConstraint,
    site: &site::Site,
) -> Result<Pin, Error> {
    let mut around: Vec<u32> = site::reach(mesh, topo, site.vertex, site.disc).iter().map(|r| r.vertex).collect();
    around.extend(topo.neighbours(site.vertex));
    around.sort_unstable();
    around.dedup();
    let mut held = vec![];
    for v in around.into_iter().filter(|&v| v != site.vertex) {
        let i = v as usize;
        let away = mesh.positions[i] - mesh.positions[site.vertex as usize];
        let direction = match s.kind {
            SingularityKind::Source => away,
            SingularityKind::Sink => -away,
            SingularityKind::Vortex => normals[i].cross(away),
            SingularityKind::Index(index) => return Err(Error::IndexNotYet { which, index }),
        };
        // A vertex straight above the point says nothing.
        if let Some(z) = frames[i].complex(direction).unit() {
            held.push((v, z.power(n)));
        }
    }
    Ok(Pin { site: *site, held })
}

/// The default's pulls (strength 0..=1, unit tangent): world up, and on floors and ceilings what continues the front.
fn default_up(normal: Vec3) -> [(f64, Vec3); 2] {
    let wall = vec3(0.0, 1.0, 0.0).reject(normal);
    let front = if normal.y > 0.0 { vec3(0.0, 0.0, -1.0) } else { vec3(0.0, 0.0, 1.0) };
    let flat = normal.y * normal.y;
    let pull = |strength: f64, v: Vec3| v.normalized().map_or((0.0, Vec3::ZERO), |v| (strength, v));
    [pull(wall.dot(wall), wall), pull(flat * flat * flat * flat, front.reject(normal))]
}

fn power_of(frame: &Frame, tangent: Vec3, n: u32) -> Complex {
    frame.complex(tangent).unit().map_or(Complex::ZERO, |z| z.power(n))
}

/// The n-th root of a number of absolute value 1 that is nearest to `preferred`.
fn root(power: Complex, n: u32, preferred: Complex) -> Complex {
    if n == 1 {
        return power;
    }
    let (s, c) = det::sin_cos(det::atan2(power.im, power.re) / f64::from(n));
    let turn = if n == 2 { complex(-1.0, 0.0) } else { complex(0.0, 1.0) };
    let nearness = |z: Complex| z.re * preferred.re + z.im * preferred.im;
    let mut best = complex(c, s);
    let mut next = best;
    for _ in 1..n {
        next = next * turn;
        if nearness(next) > nearness(best) {
            best = next;
        }
    }
    best
}

/// Weight of the default at each vertex: in the relaxation of everything, and in that of one area.
fn guide_weights(mesh: &TriMesh, topo: &Topology, pins: &[Pin]) -> Vec<[f64; 2]> {
    let (labels, count) = check::components(topo);
    let mut bounds = vec![None; count];
    for (v, p) in mesh.positions.iter().enumerate() {
        let (low, high): &mut (Vec3, Vec3) = bounds[labels[v] as usize].get_or_insert((*p, *p));
        *low = vec3(low.x.min(p.x), low.y.min(p.y), low.z.min(p.z));
        *high = vec3(high.x.max(p.x), high.y.max(p.y), high.z.max(p.z));
    }
    let diagonal = |b: &Option<(Vec3, Vec3)>| b.map_or(0.0, |(low, high)| (high - low).length());
    let diagonals: Vec<f64> = bounds.iter().map(diagonal).collect();
    let mut anchored = vec![false; count];
    pins.iter()
        .filter(|p| p.site.radius.is_none() && !p.held.is_empty())
        .for_each(|p| anchored[labels[p.site.vertex as usize] as usize] = true);

    let mut area = vec![0.0; mesh.positions.len()];
    for (f, face) in mesh.faces.iter().enumerate() {
        let third = mesh.area(f) / 3.0;
        face.iter().for_each(|&v| area[v as usize] += third);
    }
    let weights = |v: usize| {
        let component = labels[v] as usize;
        let per_area = area[v] / (diagonals[component] * diagonals[component]).max(f64::MIN_POSITIVE);
        let under = GUIDE_UNDER_ANCHORS * per_area;
        [if anchored[component] { under } else { per_area / (GUIDE_LENGTH * GUIDE_LENGTH) }, under]
    };
    par::map(mesh.positions.len(), weights)
}

#[cfg(test)]
mod tests {
    use super::super::singularities as indices;
    use super::*;
    use crate::mesh::zoo;

    fn default(m: &TriMesh, symmetry: Symmetry) -> Vec<Vec3> {
        orientation(m, &Topology::new(m), &m.vertex_normals(), &[], &[], symmetry).unwrap()
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
                let up = orientation(&m, &topo, &m.vertex_normals(), &[c], &[s], symmetry).unwrap();
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
        let up = orientation(&m, &Topology::new(&m), &m.vertex_normals(), &[c], &[], Symmetry::One).unwrap();
        assert!(up.iter().all(|u| (*u - want).length() < 1e-4));
    }

    #[test]
    fn a_radius_leaves_the_rest_as_it_was() {
        let m = zoo::plane(30, 20);
        let topo = Topology::new(&m);
        let c = anchor(vec3(7., 5., 0.), vec3(1., 0., 0.), Some(4.0));
        let without = default(&m, Symmetry::One);
        let up = orientation(&m, &topo, &m.vertex_normals(), &[c], &[], Symmetry::One).unwrap();
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
            orientation(&m, &topo, &m.vertex_normals(), &[], &[s], Symmetry::One)
        };
        for (kind, quarter) in [(SingularityKind::Source, 0), (SingularityKind::Sink, 2), (SingularityKind::Vortex, 1)]
        {
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
        assert!(e.to_string().contains("index = 0.5 is not supported yet"), "{e}");
    }

    #[test]
    fn bad_anchors_are_named() {
        let m = zoo::plane(2, 2);
        let fail = |at, up| {
            let a = [anchor(vec3(0., 0., 0.), vec3(0., 1., 0.), None), anchor(at, up, None)];
            orientation(&m, &Topology::new(&m), &m.vertex_normals(), &a, &[], Symmetry::One).unwrap_err().to_string()
        };
        let zero = Vec3::ZERO;
        assert_eq!(fail(zero, zero), "orientation constraint 1: up is the zero vector; it must have a direction");
        assert!(fail(zero, vec3(0., 0., -7.)).contains("straight out of the surface"));
        assert!(fail(zero, vec3(f64::NAN, 0., 0.)).contains("NaN"));
        assert!(fail(vec3(0., 0., 50.), vec3(1., 0., 0.)).contains("is 50 units from the surface"));
        let c = anchor(zero, vec3(1e-200, 0., 0.), None);
        assert!(orientation(&m, &Topology::new(&m), &m.vertex_normals(), &[c], &[], Symmetry::One).is_ok());
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
            orientation(m, &Topology::new(m), &m.vertex_normals(), &a, &[], Symmetry::One).unwrap()
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
}
