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
/// `up` must leave the normal by at least this (sine of the angle).
const LEAST_TANGENT: f64 = 1e-3;

/// Two constraints at one vertex whose directions differ by more than this contradict each other.
const SAME_DEG: f64 = 5.0;
/// Rounds of averaging over the 1-ring where nothing is solved.
const EVENING: usize = 12;
/// Largest index of a singularity.
const MOST_TURNS: f64 = 8.0;

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
    /// Up turns so many times around it, counter-clockwise: a multiple of one over the symmetry's directions, not 0, at
    /// most 8 either way. Which way it points is left open.
    Index(f64),
}

impl SingularityKind {
    /// Turns of up around it.
    pub fn index(self) -> f64 {
        match self {
            SingularityKind::Index(index) => index,
            _ => 1.0,
        }
    }
}

/// A singular point of the field. With a direction (all but [`SingularityKind::Index`]) it holds a small disc around a
/// vertex (at least its 1-ring), not the vertex itself.
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

#[cfg(test)]
mod tests {
    use super::super::singularities as indices;
    use super::*;
    use crate::mesh::zoo;

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
        assert!(
            run(&[anchor(p, up, None), anchor(p, -up, None)], &[], Symmetry::Two).is_ok(),
            "the same, half a turn on"
        );
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
            orientation(&m, &Topology::new(&m), &m.vertex_normals(), &a, &[], &[], Symmetry::One)
                .unwrap_err()
                .to_string()
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
}
