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

use std::collections::{BTreeMap, BTreeSet};

use super::align::{Alignment, crosses, towards};
use super::constraint::{OrientationConstraint, SingularityConstraint, SingularityKind, sites, tangential};
use super::prescribe::{Asked, Ground, Shape, shapes};
use super::relax::{Coupling, Guide, Pin, cotangent_weights, disc, relax};
use super::singularity::turning_areas;
use super::tangent::{Frame, frames, transports};
use super::{Error, Symmetry, Which, site};
use crate::mesh::{Excerpt, Topology, TriMesh, check};
use crate::numerics::csr::{Complex, complex};
use crate::numerics::vec::{Vec3, vec3};
use crate::numerics::{det, par};

/// The default pulls against smoothness over this part of the component's diagonal.
const GUIDE_LENGTH: f64 = 0.1;
/// Weight of the default under anchors, per area, in inverse squared diagonals: bends a flat field by at most about
/// this many radians, and rules where anchors' influence is weaker than it.
const GUIDE_UNDER_ANCHORS: f64 = 1e-5;
/// Two constraints at one vertex whose directions differ by more than this contradict each other.
const SAME_DEG: f64 = 5.0;
/// Rounds of averaging over the 1-ring where nothing is solved.
const EVENING: usize = 12;
/// Largest index of a singularity.
const MOST_TURNS: f64 = 8.0;

/// The orientation field: a unit vector per vertex, perpendicular to its normal.
///
/// `normals` are the unit normals of the vertices. Where constraints meet, singularities give way to anchors and
/// earlier ones to later ones; those with radius come after all without. Two that want different things at one vertex,
/// both with or both without radius, are an error. Singularities without radius are all that their component gets, if
/// it is an oriented manifold (`prescribe`); their indices must sum to its Euler characteristic if it is closed. On other
/// components, and within a radius, they hold their surroundings and what else must be arises where it costs least.
/// `align` draws the field along or across lines of the surface. For n-fold symmetry each vector is one of n equivalent
/// ones, that nearest to the default. For [`Symmetry::Isotropic`] constraints are checked and then not used. Panics if
/// `normals` or `topo` are not the mesh's.
pub fn orientation(
    mesh: &TriMesh,
    topo: &Topology,
    normals: &[Vec3],
    anchors: &[OrientationConstraint],
    singularities: &[SingularityConstraint],
    align: &[Alignment],
    symmetry: Symmetry,
) -> Result<Vec<Vec3>, Error> {
    assert_eq!((normals.len(), topo.vertex_count()), (mesh.positions.len(), mesh.positions.len()));
    let n = symmetry.directions();
    let base = Base::new((mesh, topo, normals), n, components(mesh, topo));
    let sites = sites(mesh, anchors, singularities)?;
    let asked = asked(singularities, &sites, n)?;
    let (shapes, sides) = shapes(mesh, topo, (&base.labels, base.diagonals.len()), &asked)?;
    let pins = base.pins(anchors, singularities, &sites, &shapes)?;
    let z = if symmetry == Symmetry::Isotropic {
        base.evened()
    } else {
        let mut z = base.relaxed(&pins, &shapes, None);
        let crosses = (!align.is_empty()).then(|| crosses(mesh, topo, &base.frames, align, &base.lengths()));
        if let Some(crosses) = &crosses {
            z = base.relaxed(&pins, &shapes, Some((crosses, &z)));
        }
        if !asked.is_empty() {
            let plain = Coupling {
                weights: base.coupling.weights.clone(),
                transport: vec![Complex::ONE; topo.half_edge_count()],
            };
            let areas = turning_areas(mesh, topo, normals);
            let (sides, coupling) = (&sides, &base.coupling);
            let ground = Ground { mesh, topo, sides, coupling, plain: &plain, areas: &areas, n };
            base.prescribe(&ground, &asked, &shapes, &pins, crosses.as_deref(), &mut z);
            // Areas of given radius once more, now within what surrounds them.
            base.relax_areas(&pins, crosses.as_deref(), &mut z);
        }
        z
    };
    Ok(base.vectors(&z))
}

/// The orientation field with further constraints, all with a radius: solved within their areas only, from the field
/// `up` that was laid without them. What lies outside keeps every bit. Everything else as for [`orientation()`];
/// constraints without a radius are not used here.
pub fn orientation_in_areas(
    (mesh, topo, normals): (&TriMesh, &Topology, &[Vec3]),
    up: &[Vec3],
    anchors: &[OrientationConstraint],
    singularities: &[SingularityConstraint],
    align: &[Alignment],
    symmetry: Symmetry,
) -> Result<Vec<Vec3>, Error> {
    assert_eq!((normals.len(), up.len()), (mesh.positions.len(), mesh.positions.len()));
    let n = symmetry.directions();
    let anchors: Vec<_> = anchors.iter().filter(|a| a.radius.is_some()).copied().collect();
    let singularities: Vec<_> = singularities.iter().filter(|s| s.radius.is_some()).copied().collect();
    let mut sites = sites(mesh, &anchors, &singularities)?;
    asked(&singularities, &sites, n)?;
    let reached = sites.iter().filter_map(|s| Some(site::reach(mesh, topo, s.vertex, s.radius?)));
    let inside: BTreeSet<u32> = reached.flatten().map(|r| r.vertex).collect();
    let inside: Vec<u32> = inside.into_iter().collect();
    // All that counts lies around these vertices.
    let piece = Excerpt::new(mesh, topo, &inside);
    let (labels, diagonals) = components(mesh, topo);
    let normals = piece.of(normals);
    let base = Base::new((&piece.mesh, &piece.topo, &normals), n, (piece.of(&labels), diagonals));
    sites.iter_mut().for_each(|s| s.vertex = piece.own(s.vertex).unwrap_or_default());
    let pins = base.pins(&anchors, &singularities, &sites, &[])?;
    let mut out = up.to_vec();
    if symmetry == Symmetry::Isotropic {
        return Ok(out);
    }
    let before = piece.of(up);
    let mut z = par::map(before.len(), |v| base.frames[v].complex(before[v]).power(n));
    let crosses = (!align.is_empty()).then(|| crosses(&piece.mesh, &piece.topo, &base.frames, align, &base.lengths()));
    base.relax_areas(&pins, crosses.as_deref(), &mut z);
    for (v, &there) in piece.vertices.iter().enumerate().filter(|(_, v)| inside.binary_search(v).is_ok()) {
        let Some(power) = z[v].unit() else { continue };
        let turned = base.frames[v].vector(root(power, n, base.frames[v].complex(before[v])));
        out[there as usize] = turned.normalized().unwrap_or(before[v]);
    }
    Ok(out)
}

/// Each singularity's index is one that the field can have; those without radius.
fn asked(singularities: &[SingularityConstraint], sites: &[site::Site], n: u32) -> Result<Vec<Asked>, Error> {
    let mut asked = vec![];
    for (i, (s, site)) in singularities.iter().zip(sites).enumerate() {
        let (which, index) = (Which { list: "singularity", index: i }, s.kind.index());
        let turns = index * f64::from(n);
        if !(turns == turns.round() && turns != 0.0 && index.abs() <= MOST_TURNS) {
            return Err(Error::Index { which, index, directions: n });
        }
        if site.radius.is_none() {
            asked.push(Asked { which, vertex: site.vertex, face: site.face, index });
        }
    }
    Ok(asked)
}

/// What every stage needs: bases, couplings, components, the default.
struct Base<'a> {
    mesh: &'a TriMesh,
    topo: &'a Topology,
    normals: &'a [Vec3],
    n: u32,
    frames: Vec<Frame>,
    /// Transports are n-th powers.
    coupling: Coupling,
    /// The component of each vertex.
    labels: Vec<u32>,
    /// Of each component.
    diagonals: Vec<f64>,
    /// Third of the area of each vertex's faces.
    areas: Vec<f64>,
    defaults: Vec<[(f64, Vec3); 2]>,
}

impl<'a> Base<'a> {
    /// `labels` and `diagonals` are those of [`components`], where `mesh` is a piece of another those of the whole.
    fn new(
        (mesh, topo, normals): (&'a TriMesh, &'a Topology, &'a [Vec3]),
        n: u32,
        (labels, diagonals): (Vec<u32>, Vec<f64>),
    ) -> Self {
        let frames = frames(normals);
        let carry = transports(mesh, topo, normals, &frames);
        let transport = par::map(carry.len(), |h| carry[h].power(n));
        let coupling = Coupling { weights: cotangent_weights(mesh, topo), transport };
        let mut areas = vec![0.0; mesh.positions.len()];
        for (f, face) in mesh.faces.iter().enumerate() {
            let third = mesh.area(f) / 3.0;
            face.iter().for_each(|&v| areas[v as usize] += third);
        }
        let defaults = par::map(normals.len(), |v| default_up(normals[v]));
        Base { mesh, topo, normals, n, frames, coupling, labels, diagonals, areas, defaults }
    }

    /// The vertices that each constraint holds.
    fn pins(
        &self,
        anchors: &[OrientationConstraint],
        singularities: &[SingularityConstraint],
        sites: &[site::Site],
        shapes: &[Shape],
    ) -> Result<Vec<Pin>, Error> {
        let mut pins = vec![];
        // What each vertex was asked for first: by whom, with a radius or not, which direction.
        let mut wishes: BTreeMap<(u32, bool), (Which, Option<Complex>)> = BTreeMap::new();
        let mut wish = |site: &site::Site, which: Which, direction: Option<Complex>| {
            let (first, before) = *wishes.entry((site.vertex, site.radius.is_some())).or_insert((which, direction));
            let same = match (before, direction) {
                (Some(a), Some(b)) => {
                    let off = a.conj() * b;
                    det::atan2(off.im, off.re).abs() <= f64::from(self.n) * SAME_DEG.to_radians()
                }
                _ => first == which,
            };
            let at = self.mesh.positions[site.vertex as usize];
            if same { Ok(()) } else { Err(Error::Contradiction { first, second: which, at }) }
        };
        for (i, (s, site)) in singularities.iter().zip(sites).enumerate() {
            wish(site, Which { list: "singularity", index: i }, None)?;
            let laid = site.radius.is_none()
                && matches!(shapes[self.labels[site.vertex as usize] as usize], Shape::Closed(_) | Shape::Open);
            let free = laid && matches!(s.kind, SingularityKind::Index(_));
            pins.push(if free { Pin { site: *site, held: vec![] } } else { self.ring(s.kind, site) });
        }
        for (i, (a, site)) in anchors.iter().zip(&sites[singularities.len()..]).enumerate() {
            let (which, v) = (Which { list: "orientation", index: i }, site.vertex as usize);
            let up = tangential(which, a.up, self.normals[v])?;
            let value = self.frames[v].complex(up).power(self.n);
            wish(site, which, Some(value))?;
            pins.push(disc(self.mesh, self.topo, &self.coupling, site, value));
        }
        Ok(pins)
    }

    /// What lies around a singularity (its disc, at least a ring), held at what its kind says. Rings too near to show that
    /// many turns are left open: of the 6 r or so vertices of ring r each may turn by less than half a period.
    fn ring(&self, kind: SingularityKind, site: &site::Site) -> Pin {
        let (mesh, centre) = (self.mesh, site.vertex as usize);
        let rings = (kind.index().abs() * f64::from(self.n) / 1.5).ceil() as usize;
        let (mut open, mut last) = (BTreeSet::from([site.vertex]), BTreeSet::from([site.vertex]));
        for _ in 0..rings {
            open.extend(&last);
            let next = last.iter().flat_map(|&v| self.topo.neighbours(v)).copied().filter(|v| !open.contains(v));
            last = next.collect();
        }
        let mut around = last;
        // What is held nearby only would hardly be seen if it held a point: half of its area is its own.
        let held_to = site.radius.map_or(site.disc, |r| r * 0.5);
        around.extend(site::reach(mesh, self.topo, site.vertex, held_to).iter().map(|r| r.vertex));
        let mut held = vec![];
        for v in around.into_iter().filter(|v| !open.contains(v)) {
            let i = v as usize;
            let away = mesh.positions[i] - mesh.positions[centre];
            // A vertex straight above the point says nothing.
            let Some(out) = self.frames[i].complex(away).unit() else { continue };
            let value = match kind {
                SingularityKind::Source => out.power(self.n),
                SingularityKind::Sink => (-out).power(self.n),
                SingularityKind::Vortex => self.frames[i].complex(self.normals[i].cross(away)).power(self.n),
                SingularityKind::Index(index) => {
                    // Outwards turns once; the rest is the angle around the centre.
                    let Some(angle) = self.frames[centre].complex(away).unit() else { continue };
                    let more = ((index - 1.0) * f64::from(self.n)).round();
                    let angle = if more < 0.0 { angle.conj() } else { angle };
                    let turn = if more == 0.0 { Complex::ONE } else { angle.power(more.abs() as u32) };
                    out.power(self.n) * turn
                }
            };
            held.push((v, value.unit().unwrap_or(Complex::ONE)));
        }
        Pin { site: *site, held }
    }

    /// Up to which length the default and alignment compete with smoothness, per vertex.
    fn lengths(&self) -> Vec<f64> {
        self.labels.iter().map(|&l| GUIDE_LENGTH * self.diagonals[l as usize]).collect()
    }

    /// The default's pull at a vertex, as strong as it lies in the surface, and its weight.
    fn pull(&self, v: usize) -> (f64, Complex) {
        let pull = self.defaults[v].iter().map(|&(w, t)| power_of(&self.frames[v], t, self.n) * w);
        (self.defaults[v].iter().map(|d| d.0).sum(), pull.fold(Complex::ZERO, |s, p| s + p))
    }

    /// The default where a whole component follows it, and the weak one under anchors.
    fn guides(&self, pins: &[Pin]) -> [Vec<Guide>; 2] {
        let mut anchored = vec![false; self.diagonals.len()];
        pins.iter()
            .filter(|p| p.site.radius.is_none() && !p.held.is_empty())
            .for_each(|p| anchored[self.labels[p.site.vertex as usize] as usize] = true);
        let both = par::map(self.normals.len(), |v| {
            let l = self.labels[v] as usize;
            let per_area = self.areas[v] / (self.diagonals[l] * self.diagonals[l]).max(f64::MIN_POSITIVE);
            let under = GUIDE_UNDER_ANCHORS * per_area;
            let (total, pull) = self.pull(v);
            let guide = |w: f64| Guide { weight: total * w, pull: pull * w };
            [guide(if anchored[l] { under } else { per_area / (GUIDE_LENGTH * GUIDE_LENGTH) }), guide(under)]
        });
        [0, 1].map(|k| both.iter().map(|g| g[k]).collect())
    }

    /// The smoothest field that pins and the default allow; drawn to crosses, of their arms those nearest to a field.
    /// Components of which all singularities are given stay zero, but for the pins.
    fn relaxed(&self, pins: &[Pin], shapes: &[Shape], drawn: Option<(&[Complex], &[Complex])>) -> Vec<Complex> {
        let free = |v: usize| !matches!(shapes[self.labels[v] as usize], Shape::Closed(_) | Shape::Open);
        let free: Vec<bool> = (0..self.normals.len()).map(free).collect();
        let mut z = vec![Complex::ZERO; self.normals.len()];
        if let Some((crosses, near)) = drawn {
            z.copy_from_slice(near);
            self.relax_all(pins, &free, Some(crosses), &mut z);
        } else {
            self.relax_all(pins, &free, None, &mut z);
        }
        z
    }

    fn relax_all(&self, pins: &[Pin], free: &[bool], crosses: Option<&[Complex]>, z: &mut [Complex]) {
        let mut guides = self.guides(pins);
        if let Some(crosses) = crosses {
            for (v, cross) in crosses.iter().enumerate() {
                let now = z[v].unit().unwrap_or(self.pull(v).1);
                let more = towards(*cross, self.n, now);
                for g in &mut guides {
                    g[v].weight += more.weight;
                    g[v].pull += more.pull;
                }
            }
        }
        relax(self.mesh, self.topo, &self.coupling, pins, free, [&guides[0], &guides[1]], z);
    }

    /// Relaxes the areas of the pins with a radius again, all else held.
    fn relax_areas(&self, pins: &[Pin], crosses: Option<&[Complex]>, z: &mut [Complex]) {
        if pins.iter().any(|p| p.site.radius.is_some()) {
            self.relax_all(pins, &vec![false; z.len()], crosses, z);
        }
    }

    /// Lays the components of which all singularities are given.
    fn prescribe(
        &self,
        ground: &Ground<'_>,
        asked: &[Asked],
        shapes: &[Shape],
        pins: &[Pin],
        crosses: Option<&[Complex]>,
        z: &mut [Complex],
    ) {
        let turns = ground.turns(asked);
        let mut done = vec![false; self.diagonals.len()];
        for root in 0..z.len() as u32 {
            let l = self.labels[root as usize] as usize;
            let laid = matches!(shapes[l], Shape::Closed(_) | Shape::Open);
            if !laid || std::mem::replace(&mut done[l], true) {
                continue;
            }
            let everywhere = |p: &&Pin| p.site.radius.is_none() && self.labels[p.site.vertex as usize] as usize == l;
            let here: Vec<&Pin> = pins.iter().filter(everywhere).collect();
            let pull = |v: u32| self.pull(v as usize).1 * self.areas[v as usize];
            let steer = crosses.map(|c| {
                move |v: u32, now: Complex| {
                    let g = towards(c[v as usize], self.n, now);
                    (g.weight, g.pull)
                }
            });
            let steer = steer.as_ref().map(|s| s as &dyn Fn(u32, Complex) -> (f64, Complex));
            ground.lay((root, shapes[l]), &turns, &here, pull, steer, z);
        }
    }

    /// The default, evened out over a few rings.
    fn evened(&self) -> Vec<Complex> {
        let pulls = par::map(self.normals.len(), |v| self.pull(v));
        let mut z: Vec<Complex> = pulls.iter().map(|p| p.1).collect();
        for _ in 0..EVENING {
            z = par::map(z.len(), |v| {
                let row = self.topo.half_edges(v as u32);
                let (mut sum, mut weight) = (z[v], 1.0);
                for h in row {
                    let w = self.coupling.weights[h];
                    sum += self.coupling.transport[h].conj() * z[self.topo.target(h) as usize] * w;
                    weight += w;
                }
                sum * (1.0 / weight)
            });
        }
        z
    }

    /// Unit vectors of n-th powers, of the equivalent ones those nearest to the default.
    fn vectors(&self, z: &[Complex]) -> Vec<Vec3> {
        par::map(z.len(), |v| {
            // Where smoothness cancels all: the default, or any direction.
            let power = z[v].unit().or(self.pull(v).1.unit()).unwrap_or(Complex::ONE);
            let preferred = self.defaults[v].iter().fold(Vec3::ZERO, |s, &(w, t)| s + t * w);
            let up = self.frames[v].vector(root(power, self.n, self.frames[v].complex(preferred)));
            up.normalized().unwrap_or(up)
        })
    }
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

/// The component of each vertex, and the diagonal of the bounding box of each component.
fn components(mesh: &TriMesh, topo: &Topology) -> (Vec<u32>, Vec<f64>) {
    let (labels, count) = check::components(topo);
    let mut bounds = vec![None; count];
    for (v, p) in mesh.positions.iter().enumerate() {
        let (low, high): &mut (Vec3, Vec3) = bounds[labels[v] as usize].get_or_insert((*p, *p));
        *low = vec3(low.x.min(p.x), low.y.min(p.y), low.z.min(p.z));
        *high = vec3(high.x.max(p.x), high.y.max(p.y), high.z.max(p.z));
    }
    let diagonals = bounds.iter().map(|b| b.map_or(0.0, |(low, high)| (high - low).length())).collect();
    (labels, diagonals)
}
