//! Fields with exactly the singularities that are asked for: trivial connections.
//!
//! Source: Crane, Desbrun, Schröder 2010 (Trivial Connections on Discrete Surfaces), for directions at vertices as in
//! Knöppel et al. 2013 instead of at faces. Along each edge the direction may turn by a small angle x against parallel
//! transport; around each face these must make up for what transport itself turns, but for the whole turns of the face's
//! index, and around each loop that bounds nothing they must close up as well. Of all such angles those of the least
//! weighted squares are wanted.
//!
//! Reads as: some angles that do so are found by a tree of edges and a tree of faces that crosses none of them (Eppstein
//! 2003): faces are set right from the leaves of theirs to the root, and each edge in neither tree closes one loop.
//! What remains is one Poisson equation at the vertices, since all other solutions of the same turns (the nearest whole
//! ones around loops) differ by a rotation per vertex. What anchors ask for is a second one: a rotation on top, harmonic
//! between them, so it never adds a singularity. All in n-th powers of directions.
//!
//! Needs an oriented manifold, with or without boundary. Unaware of: what a singularity's surroundings look like.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use super::relax::{Coupling, Guide, Pin, solve};
use super::{Error, Which};
use crate::mesh::{Topology, TriMesh, check};
use crate::numerics::csr::{Complex, complex};
use crate::numerics::det;

/// How a component hangs together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// No component with a singularity that acts everywhere.
    Unasked,
    /// A closed oriented manifold of this Euler characteristic.
    Closed(i64),
    /// An oriented manifold with a boundary.
    Open,
    /// Neither: three faces at an edge, fans that meet in a vertex, faces that disagree on the outside.
    Tangled,
}

/// A singularity that acts on its whole component.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub which: Which,
    pub vertex: u32,
    pub face: u32,
    /// Turns, a multiple of 1/n.
    pub index: f64,
}

const NONE: u32 = u32::MAX;

/// The faces on the left and on the right of each half-edge that points to the greater vertex.
pub(super) struct Sides(Vec<[u32; 2]>);

/// The shape of each component; `labels` are the vertices' components. Fails where indices do not fit a closed one.
pub(super) fn shapes(
    mesh: &TriMesh,
    topo: &Topology,
    (labels, count): (&[u32], usize),
    asked: &[Asked],
) -> Result<(Vec<Shape>, Sides), Error> {
    let mut shapes = vec![Shape::Unasked; count];
    asked.iter().for_each(|a| shapes[labels[a.vertex as usize] as usize] = Shape::Closed(0));
    let mut sides = vec![[NONE; 2]; topo.half_edge_count()];
    if asked.is_empty() {
        return Ok((shapes, Sides(sides)));
    }
    let mut euler = vec![0i64; count];
    for (f, face) in mesh.faces.iter().enumerate() {
        let l = labels[face[0] as usize] as usize;
        euler[l] += 1;
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            match topo.find(a.min(b), a.max(b)) {
                Some(h) if sides[h][usize::from(a > b)] == NONE => sides[h][usize::from(a > b)] = f as u32,
                _ => shapes[l] = tangle(shapes[l]),
            }
        }
    }
    for v in 0..topo.vertex_count() as u32 {
        let l = labels[v as usize] as usize;
        if shapes[l] == Shape::Unasked {
            continue;
        }
        euler[l] += 1;
        if check::fans(mesh, topo, v) > 1 {
            shapes[l] = Shape::Tangled;
        }
        for h in topo.half_edges(v).filter(|&h| v < topo.target(h)) {
            euler[l] -= 1;
            if sides[h].contains(&NONE) && shapes[l] != Shape::Tangled {
                shapes[l] = Shape::Open;
            }
        }
    }
    for (l, shape) in shapes.iter_mut().enumerate() {
        let here = || asked.iter().filter(|a| labels[a.vertex as usize] as usize == l);
        let sum: f64 = here().map(|a| a.index).sum();
        if let (Shape::Closed(_), Some(first)) = (*shape, here().next()) {
            if sum != euler[l] as f64 {
                return Err(Error::Indices { which: first.which, count: here().count(), sum, euler: euler[l] });
            }
            *shape = Shape::Closed(euler[l]);
        }
    }
    Ok((shapes, Sides(sides)))
}

fn tangle(shape: Shape) -> Shape {
    if shape == Shape::Unasked { shape } else { Shape::Tangled }
}

/// A vertex of a spanning tree, and the half-edge to it with the vertex before.
type Branch = (u32, Option<(usize, u32)>);

/// What the field of a component is made from.
pub(super) struct Ground<'a> {
    pub mesh: &'a TriMesh,
    pub topo: &'a Topology,
    pub sides: &'a Sides,
    /// Transports in n-th powers, and weights.
    pub coupling: &'a Coupling,
    /// The same weights, and nothing turned.
    pub plain: &'a Coupling,
    /// By how much transport turns around each face, not in n-th powers.
    pub areas: &'a [f64],
    /// Directions that are equivalent.
    pub n: u32,
}

impl Ground<'_> {
    /// The half-edge of an edge that points to its greater vertex, and the sign of going from `a` to `b`.
    fn edge(&self, a: u32, b: u32) -> Option<(usize, f64)> {
        Some((self.topo.find(a.min(b), a.max(b))?, if a < b { 1.0 } else { -1.0 }))
    }

    /// The edges around a face with the signs of going around it.
    fn around(&self, f: u32) -> impl Iterator<Item = (usize, f64)> + '_ {
        let [a, b, c] = self.mesh.faces[f as usize];
        [(a, b), (b, c), (c, a)].into_iter().filter_map(|(a, b)| self.edge(a, b))
    }

    /// Whole turns (in n-th powers) of the faces: those of each singularity on as many faces as it has n-th turns, since
    /// one face shows no more; the nearest face first, then those around its vertex, then around their vertices.
    pub fn turns(&self, asked: &[Asked]) -> Vec<f64> {
        let mut turns = vec![0.0; self.mesh.faces.len()];
        for a in asked {
            let wanted = (a.index * f64::from(self.n)).round();
            let mut faces = vec![a.face];
            let (mut vertices, mut next) = (vec![a.vertex], 0);
            while faces.len() < wanted.abs() as usize && next < vertices.len() {
                let v = vertices[next];
                next += 1;
                for &f in self.topo.faces(v) {
                    if !faces.contains(&f) {
                        faces.push(f);
                    }
                }
                for &w in self.topo.neighbours(v) {
                    if !vertices.contains(&w) {
                        vertices.push(w);
                    }
                }
            }
            for i in 0..wanted.abs() as usize {
                turns[faces[i % faces.len()] as usize] += wanted.signum();
            }
        }
        turns
    }

    /// A spanning tree of the component of `root` in breadth: its vertices in order, each with the half-edge that led
    /// to it and the vertex that this one leaves from.
    fn vertex_tree(&self, root: u32) -> Vec<Branch> {
        let mut seen = vec![false; self.topo.vertex_count()];
        let mut tree = vec![(root, None)];
        seen[root as usize] = true;
        let mut next = 0;
        while next < tree.len() {
            let v = tree[next].0;
            next += 1;
            for h in self.topo.half_edges(v) {
                let w = self.topo.target(h);
                if !std::mem::replace(&mut seen[w as usize], true) {
                    tree.push((w, Some((h, v))));
                }
            }
        }
        tree
    }

    /// A spanning tree of faces across the edges that are not `taken` (and then are): faces in order, each with the edge
    /// that led to it (`None` for the root). Faces at the boundary hang on the outside, all others on the first face.
    fn face_tree(&self, edges: &[usize], taken: &mut [bool], shape: Shape) -> Vec<(u32, Option<usize>)> {
        let mut seen = vec![false; self.mesh.faces.len()];
        let mut tree: Vec<(u32, Option<usize>)> = vec![];
        if shape == Shape::Open {
            for &e in edges {
                let [l, r] = self.sides.0[e];
                let inner = if l == NONE { r } else { l };
                if (l == NONE || r == NONE) && !taken[e] && !std::mem::replace(&mut seen[inner as usize], true) {
                    taken[e] = true;
                    tree.push((inner, Some(e)));
                }
            }
        } else if let Some(&e) = edges.first() {
            let [first, _] = self.sides.0[e];
            seen[first as usize] = true;
            tree.push((first, None));
        }
        let mut next = 0;
        while next < tree.len() {
            let f = tree[next].0;
            next += 1;
            for (e, _) in self.around(f).filter(|&(e, _)| !taken[e]).collect::<Vec<_>>() {
                let [l, r] = self.sides.0[e];
                let other = if l == f { r } else { l };
                if other != NONE && !std::mem::replace(&mut seen[other as usize], true) {
                    taken[e] = true;
                    tree.push((other, Some(e)));
                }
            }
        }
        tree
    }

    /// Lays the singularities into the component of `root` and holds it at `pins`: writes unit numbers into `z`.
    ///
    /// `pull` says, without pins, which of the rotations of the whole is preferred. `steer` (may be called after that)
    /// gives each vertex a weight and where it is drawn to, knowing its number so far.
    pub fn lay(
        &self,
        (root, shape): (u32, Shape),
        turns: &[f64],
        pins: &[&Pin],
        pull: impl Fn(u32) -> Complex,
        steer: Option<&dyn Fn(u32, Complex) -> (f64, Complex)>,
        z: &mut [Complex],
    ) {
        let tree = self.vertex_tree(root);
        let mut vertices: Vec<u32> = tree.iter().map(|t| t.0).collect();
        vertices.sort_unstable();
        z[root as usize] = Complex::ONE;
        for &(v, from) in &tree {
            if let Some((h, before)) = from {
                z[v as usize] = (self.coupling.transport[h] * z[before as usize]).unit().unwrap_or(Complex::ONE);
            }
        }
        let mut x = self.closing_angles(&vertices, &tree, shape, turns, z);
        self.smooth(&vertices, &mut x, z);
        let mut angle = self.hold(pins, &x, z);
        let held = angle.iter().any(Option::is_some);
        let start = if held {
            self.harmonic(&vertices, &angle, None)
        } else {
            let sum = vertices.iter().fold(Complex::ZERO, |s, &v| s + z[v as usize].conj() * pull(v));
            vec![det::atan2(sum.im, sum.re); z.len()]
        };
        let turned = |angles: &[f64], v: u32| z[v as usize] * unit(angles[v as usize]);
        let last = match steer {
            None => start,
            Some(steer) => {
                let guide = |v: u32| {
                    let now = turned(&start, v);
                    let (weight, to) = steer(v, now);
                    let off = now.conj() * to;
                    let goal = start[v as usize] + det::atan2(off.im, off.re);
                    Guide { weight, pull: complex(weight * goal, 0.0) }
                };
                let mut guides = vec![Guide::default(); z.len()];
                vertices.iter().for_each(|&v| guides[v as usize] = guide(v));
                let steered = vertices.iter().any(|&v| guides[v as usize].weight > 0.0);
                if !held && !steered {
                    // Nothing fixes the whole: keep one vertex.
                    angle[root as usize] = Some(start[root as usize]);
                }
                self.harmonic(&vertices, &angle, Some(&guides))
            }
        };
        let result: Vec<Complex> = vertices.iter().map(|&v| turned(&last, v)).collect();
        vertices.iter().zip(result).for_each(|(&v, r)| z[v as usize] = r);
    }

    /// Angles along the edges with the right turns around every face and loop; nothing along the tree.
    fn closing_angles(
        &self,
        vertices: &[u32],
        tree: &[Branch],
        shape: Shape,
        turns: &[f64],
        z: &[Complex],
    ) -> Vec<f64> {
        let up = |v: u32| self.topo.half_edges(v).filter(move |&h| v < self.topo.target(h));
        let edges: Vec<usize> = vertices.iter().flat_map(|&v| up(v)).collect();
        let mut taken = vec![false; self.topo.half_edge_count()];
        for &(v, h) in tree {
            if let Some((e, _)) = h.and_then(|(_, before)| self.edge(before, v)) {
                taken[e] = true;
            }
        }
        let faces = self.face_tree(&edges, &mut taken, shape);
        let mut x = vec![0.0; self.topo.half_edge_count()];
        let mut up_edge = vec![None; self.mesh.faces.len()];
        for &(f, e) in faces.iter().rev() {
            up_edge[f as usize] = e;
            let Some(e) = e else { continue };
            let sum: f64 = self.around(f).map(|(e, sign)| sign * x[e]).sum();
            let wanted = TAU * turns[f as usize] - f64::from(self.n) * self.areas[f as usize];
            x[e] += self.sign(f, e) * (wanted - sum);
        }
        for &a in vertices {
            for e in up(a).filter(|&e| !taken[e]) {
                let b = self.topo.target(e) as usize;
                let there = self.coupling.transport[e] * z[a as usize] * unit(x[e]);
                let miss = there.conj() * z[b];
                let miss = det::atan2(miss.im, miss.re);
                x[e] += miss;
                for (side, by) in self.sides.0[e].into_iter().zip([-miss, miss]) {
                    self.push_up(side, by, &up_edge, &mut x);
                }
            }
        }
        x
    }

    /// +1 if the face is on the left of the edge, else -1.
    fn sign(&self, f: u32, e: usize) -> f64 {
        if self.sides.0[e][0] == f { 1.0 } else { -1.0 }
    }

    /// Adds `by` to the turn around a face and takes it out at the root of the faces' tree.
    fn push_up(&self, face: u32, by: f64, up_edge: &[Option<usize>], x: &mut [f64]) {
        let mut f = face;
        while f != NONE {
            let Some(e) = up_edge[f as usize] else { return };
            x[e] += self.sign(f, e) * by;
            let [l, r] = self.sides.0[e];
            f = if l == f { r } else { l };
        }
    }

    /// Rotates the vertices so that the angles become those of the least weighted squares.
    fn smooth(&self, vertices: &[u32], x: &mut [f64], z: &mut [Complex]) {
        let mut guides = vec![Guide::default(); z.len()];
        for &v in vertices {
            for h in self.topo.half_edges(v).filter(|&h| v < self.topo.target(h)) {
                let flow = complex(self.coupling.weights[h] * x[h], 0.0);
                guides[v as usize].pull += flow;
                guides[self.topo.target(h) as usize].pull -= flow;
            }
        }
        let mut held = vec![None; z.len()];
        held[vertices[0] as usize] = Some(0.0);
        let angle = self.harmonic(vertices, &held, Some(&guides));
        for &v in vertices {
            for h in self.topo.half_edges(v).filter(|&h| v < self.topo.target(h)) {
                x[h] += angle[self.topo.target(h) as usize] - angle[v as usize];
            }
            z[v as usize] = z[v as usize] * unit(angle[v as usize]);
        }
    }

    /// Real numbers at the vertices, smooth between those held and drawn to the guides.
    fn harmonic(&self, vertices: &[u32], held: &[Option<f64>], guides: Option<&[Guide]>) -> Vec<f64> {
        let none = if guides.is_none() { vec![Guide::default(); held.len()] } else { vec![] };
        let open: Vec<u32> = vertices.iter().copied().filter(|&v| held[v as usize].is_none()).collect();
        let mut values: Vec<Complex> = held.iter().map(|h| complex(h.unwrap_or(0.0), 0.0)).collect();
        solve(self.topo, self.plain, &open, guides.unwrap_or(&none), &mut values);
        values.iter().map(|v| v.re).collect()
    }

    /// By how much the pins turn the field at their vertices. Within a pin as continuous as the angles say; of the whole
    /// turns between one pin and the next the nearest.
    fn hold(&self, pins: &[&Pin], x: &[f64], z: &[Complex]) -> Vec<Option<f64>> {
        let mut angle = vec![None; z.len()];
        let mut last = 0.0;
        for pin in pins {
            let wanted = |v: u32| pin.held.binary_search_by_key(&v, |h| h.0).ok().map(|i| pin.held[i].1);
            let mut open: BTreeSet<u32> = pin.held.iter().map(|h| h.0).collect();
            while let Some(start) = open.pop_first() {
                let off = wanted(start).map_or(Complex::ONE, |to| z[start as usize].conj() * to);
                let off = det::atan2(off.im, off.re);
                last = off + ((last - off) / TAU).round() * TAU;
                angle[start as usize] = Some(last);
                let mut queue = vec![(start, last)];
                while let Some((v, here)) = queue.pop() {
                    for h in self.topo.half_edges(v) {
                        let w = self.topo.target(h);
                        let (Some(from), Some(to)) = (wanted(v), wanted(w)) else { continue };
                        if open.remove(&w) {
                            let turn = (self.coupling.transport[h] * from).conj() * to;
                            let along = self.edge(v, w).map_or(0.0, |(e, sign)| sign * x[e]);
                            let there = here + det::atan2(turn.im, turn.re) - along;
                            angle[w as usize] = Some(there);
                            queue.push((w, there));
                        }
                    }
                }
            }
        }
        angle
    }
}

/// The number of absolute value 1 at an angle.
fn unit(angle: f64) -> Complex {
    let (s, c) = det::sin_cos(angle);
    complex(c, s)
}

#[cfg(test)]
mod tests {
    use super::super::{
        Alignment, OrientationConstraint, SingularityConstraint, SingularityKind, Symmetry, orientation,
        singular_points, singularities,
    };
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::{Vec3, vec3};

    fn at(at: Vec3, index: f64) -> SingularityConstraint {
        SingularityConstraint { at, kind: SingularityKind::Index(index), radius: None }
    }

    /// Singular points and their indices.
    type Points = Vec<(Vec3, f64)>;

    /// The field and its singular points.
    fn lay(
        m: &TriMesh,
        anchors: &[OrientationConstraint],
        asked: &[SingularityConstraint],
        symmetry: Symmetry,
    ) -> Result<(Vec<Vec3>, Points), Error> {
        let (topo, normals) = (Topology::new(m), m.vertex_normals());
        let up = orientation(m, &topo, &normals, anchors, asked, &[], symmetry)?;
        let found = singularities(m, &topo, &normals, &up, symmetry);
        let points = singular_points(m, &found).iter().map(|p| (p.at, p.index)).collect();
        Ok((up, points))
    }

    /// Each of the wanted is found nearby, and no other.
    fn same(found: &[(Vec3, f64)], wanted: &[SingularityConstraint], near: f64) -> bool {
        let is = |f: &(Vec3, f64), w: &SingularityConstraint| {
            (f.0 - w.at).length() < near && (f.1 - w.kind.index()).abs() < 1e-9
        };
        found.len() == wanted.len() && wanted.iter().all(|w| found.iter().any(|f| is(f, w)))
    }

    #[test]
    fn a_sphere_has_exactly_what_is_asked_for() {
        let m = zoo::icosphere(4);
        let (x, y, z) = (vec3(1., 0., 0.), vec3(0., 1., 0.), vec3(0., 0., 1.));
        let diagonal = vec3(0.6, 0.64, 0.48);
        let cases: [(Symmetry, Vec<(Vec3, f64)>); 6] = [
            (Symmetry::One, vec![(y, 1.0), (-y, 1.0)]),
            (Symmetry::One, vec![(x, 1.0), (diagonal, 1.0)]),
            (Symmetry::One, vec![(x, 1.0), (y, 1.0), (z, 1.0), (-diagonal, -1.0)]),
            (Symmetry::Two, vec![(x, 0.5), (-x, 0.5), (z, 0.5), (-y, 0.5)]),
            (Symmetry::Two, vec![(x, 1.5), (-x, 0.5)]),
            (Symmetry::Four, [x, -x, y, -y, z, -z, diagonal, -diagonal].map(|p| (p, 0.25)).to_vec()),
        ];
        for (symmetry, wanted) in cases {
            let wanted: Vec<_> = wanted.into_iter().map(|(p, i)| at(p, i)).collect();
            let (up, found) = lay(&m, &[], &wanted, symmetry).unwrap();
            assert!(same(&found, &wanted, 0.2), "{symmetry:?} {wanted:?}: {found:?}");
            assert!(up.iter().all(|u| (u.length() - 1.0).abs() < 1e-12));
        }
    }

    #[test]
    fn anchors_turn_the_field_and_add_nothing() {
        let m = zoo::icosphere(4);
        let wanted = [at(vec3(0., 1., 0.), 1.0), at(vec3(0., -1., 0.), 1.0)];
        let anchor = |at, up| OrientationConstraint { at, up, radius: None };
        let (x, y) = (vec3(1., 0., 0.), vec3(0., 1., 0.));
        // Opposite wishes on opposite sides: a half turn lies between, and nothing tears.
        let anchors = [anchor(x, y), anchor(-x, -y), anchor(vec3(0., 0., 1.), x)];
        let (up, found) = lay(&m, &anchors, &wanted, Symmetry::One).unwrap();
        assert!(same(&found, &wanted, 0.2), "{found:?}");
        for a in anchors {
            let away = |v: usize| (m.positions[v] - a.at).length();
            let v = (0..up.len()).min_by(|&p, &q| away(p).total_cmp(&away(q))).unwrap();
            assert!(up[v].dot(a.up) > 0.99, "{a:?}: {:?}", up[v]);
        }
    }

    #[test]
    fn a_source_and_a_sink_are_the_poles_of_meridians() {
        let m = zoo::icosphere(4);
        let pole = |y: f64, kind| SingularityConstraint { at: vec3(0., y, 0.), kind, radius: None };
        let poles = [pole(-1., SingularityKind::Source), pole(1., SingularityKind::Sink)];
        let (up, found) = lay(&m, &[], &poles, Symmetry::One).unwrap();
        assert!(same(&found, &poles, 0.2), "{found:?}");
        for (p, u) in m.positions.iter().zip(&up).filter(|(p, _)| p.y.abs() < 0.9) {
            let north = vec3(0., 1., 0.).reject(*p).normalized().unwrap();
            assert!(u.dot(north) > 0.99, "{p:?} {u:?}");
        }
    }

    #[test]
    fn tori_close_around_their_holes() {
        let mut meshes = vec![zoo::torus(40, 20)];
        meshes.extend(zoo::obj("bob.obj"));
        for m in meshes {
            let n = m.positions.len();
            for (symmetry, k) in [(Symmetry::One, 1.0), (Symmetry::Two, 0.5), (Symmetry::Four, 0.25)] {
                let wanted = [at(m.positions[0], k), at(m.positions[n / 2], -k)];
                let (_, found) = lay(&m, &[], &wanted, symmetry).unwrap();
                let near = 0.1 * (m.bounds().1 - m.bounds().0).length();
                assert!(same(&found, &wanted, near), "{symmetry:?}: {found:?}");
            }
        }
    }

    #[test]
    fn an_open_surface_takes_any_index() {
        let m = zoo::plane(20, 20);
        for (symmetry, k) in [(Symmetry::One, -1.0), (Symmetry::One, 1.0), (Symmetry::Two, 0.5), (Symmetry::Four, 0.25)]
        {
            let wanted = [at(vec3(10.3, 9.6, 0.), k)];
            let (_, found) = lay(&m, &[], &wanted, symmetry).unwrap();
            assert!(same(&found, &wanted, 2.0), "{symmetry:?} {k}: {found:?}");
        }
    }

    #[test]
    fn sums_that_do_not_fit_say_what_would() {
        let fail = |m: &TriMesh, asked: &[SingularityConstraint]| lay(m, &[], asked, Symmetry::One).unwrap_err();
        let source = |at, radius| SingularityConstraint { at, kind: SingularityKind::Source, radius };
        let sphere = zoo::icosphere(2);
        let text = fail(&sphere, &[source(vec3(0., 1., 0.), None)]).to_string();
        assert!(text.contains("Euler characteristic, here 2"), "{text}");
        assert!(text.contains("sum to 1: add singularities of index 1 in all"), "{text}");
        let torus = zoo::torus(12, 8);
        let text = fail(&torus, &[at(torus.positions[0], 1.0)]).to_string();
        assert!(text.contains("here 0") && text.contains("of index -1 in all"), "{text}");
        let text = fail(&sphere, &[at(vec3(0., 1., 0.), 0.5)]).to_string();
        assert!(text.contains("the index is 0.5; it must be a multiple of 1/1"), "{text}");
        assert!(lay(&sphere, &[], &[source(vec3(0., 1., 0.), Some(0.5))], Symmetry::One).is_ok(), "only nearby");
    }

    #[test]
    fn within_a_radius_an_index_is_made_up_for_around_it() {
        let m = zoo::plane(40, 40);
        for (symmetry, k) in [(Symmetry::One, -1.0), (Symmetry::Two, 0.5), (Symmetry::Four, -0.75)] {
            let s = SingularityConstraint { radius: Some(12.0), ..at(vec3(20., 20., 0.), k) };
            let (_, found) = lay(&m, &[], &[s], symmetry).unwrap();
            let inner: f64 = found.iter().filter(|f| (f.0 - s.at).length() < 5.0).map(|f| f.1).sum();
            assert!((inner - k).abs() < 1e-9, "{symmetry:?}: {found:?}");
            assert!(found.iter().all(|f| (f.0 - s.at).length() < 13.0), "{found:?}");
        }
    }

    #[test]
    fn the_zoo_is_laid_or_refused_by_its_sum() {
        for (name, m) in zoo::all() {
            for (symmetry, k) in [(Symmetry::One, 2.0), (Symmetry::Two, -0.5), (Symmetry::Four, 1.0)] {
                let all = [Alignment::Creases, Alignment::Boundary, Alignment::Curvature];
                let (topo, normals) = (Topology::new(&m), m.vertex_normals());
                match orientation(&m, &topo, &normals, &[], &[at(m.positions[0], k)], &all, symmetry) {
                    Ok(up) => assert!(up.iter().all(|u| (u.length() - 1.0).abs() < 1e-12), "{name} {symmetry:?}"),
                    Err(e) => assert!(matches!(e, Error::Indices { .. }), "{name} {symmetry:?}: {e}"),
                }
            }
        }
    }

    #[test]
    fn the_same_bytes_on_any_number_of_threads() {
        use crate::numerics::par;
        let m = zoo::icosphere(5);
        let wanted = [at(vec3(0., 1., 0.), 1.0), at(vec3(0., -1., 0.), 1.0)];
        let run = |jobs| par::install(jobs, || lay(&m, &[], &wanted, Symmetry::One).unwrap().0);
        assert!(run(1) == run(4));
    }
}
