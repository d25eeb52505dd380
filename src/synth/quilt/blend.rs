//! Blending over the edges of a quilt, as sets of coordinates with weights that are linear over triangles.
//!
//! Source: \[MK03\] section 3.3.1, figure 6, and the blend metric of 3.3.2. In: where each face lies, the continuity error of
//! each edge and a threshold. Out: the mesh with the faces beside blended edges divided, its sets and weights, and per
//! corner the error and length of the edge that is blended there.
//! Reads as: the paper adds the textures across a face's three edges, each with a weight that falls towards the opposite
//! corner. Where two edges meet this leaves steps (the face beyond one edge knows nothing of the other's neighbour), and
//! weights that are linear over the whole triangle would have to vanish at all corners. So a face with edges to be blended
//! is divided into triangles around its centre, whose middle edge points are shared with the face beyond. Sets: 0 the
//! face's own place, 1 the place across the edge, 2 and 3 the places that rule at the edge's two ends. Own and other weigh
//! half each at the middle of the edge, own weighs one at the centre, and at a vertex all faces show one and the same
//! place: that of the largest part of the faces around it that meet without a blended edge. The result is continuous
//! everywhere, also at vertices; test `the_blend_is_continuous_across_edges`.
//! Unaware of: how the quilt was made, colours.

use super::frame::Facets;
use crate::mesh::SynthesisMesh;
use crate::numerics::det;
use crate::numerics::vec::{Vec2, Vec3, vec2};
use crate::synth::Error;
use crate::texture::{Texel, texel};
use crate::uvset::{Blend, UvSets};

/// Frames that are turned by more than this against each other, in radians, have no common mean; the lower face's counts.
const SHARP_TURN: f64 = 0.8;

/// A quilt with its edges blended.
#[derive(Clone, Debug, PartialEq)]
pub struct Blended {
    /// The mesh that the sets belong to.
    pub mesh: SynthesisMesh,
    /// Coordinates and weights: one set if no edge is blended, else four.
    pub sets: UvSets,
    /// For each corner the continuity error and the length, in world units, of the edge that its triangle blends, the same
    /// at all three; of a triangle that only blends towards a ruling place those of the worst blended edge at that vertex;
    /// zeros where nothing is blended.
    pub metric: Vec<[f32; 2]>,
    /// Number of edges that are blended.
    pub blended: u64,
}

/// Blends the edges whose error exceeds `threshold`.
///
/// `at`: where the first corner of each face lies, in texels; `errors[face][edge]`: the continuity error, the same from
/// both sides, anything at borders. With [`Blend::Nearest`] nothing is blended. Fails if counts differ or the threshold is
/// not a number of at least 0.
pub fn blend_edges(
    mesh: &SynthesisMesh,
    facets: &Facets,
    at: &[Vec2],
    errors: &[[f32; 3]],
    threshold: f32,
    exemplar_size: [u32; 2],
    blend: Blend,
) -> Result<Blended, Error> {
    let n = mesh.mesh.faces.len();
    for (what, found) in
        [("places of faces", at.len()), ("errors of faces", errors.len()), ("faces laid flat", facets.len())]
    {
        if found != n {
            return Err(Error::Count { what, found, expected: n });
        }
    }
    if !(threshold >= 0.0 && threshold.is_finite()) {
        return Err(Error::Threshold(f64::from(threshold)));
    }
    let seam = |f: usize, k: usize| facets.across[f][k] != super::frame::BORDER && errors[f][k] > threshold;
    let mut seams: Vec<[bool; 3]> = (0..n).map(|f| [0, 1, 2].map(|k| seam(f, k))).collect();
    if blend == Blend::Nearest {
        seams = vec![[false; 3]; n];
    }
    let rule = Rule::new(mesh, facets, at, errors, &seams);
    let mut out = Builder {
        source: mesh,
        facets,
        at,
        errors,
        seams: &seams,
        rule: &rule,
        size: exemplar_size,
        middles: vec![[u32::MAX; 3]; n],
        out: SynthesisMesh { parent: vec![], parent_bary: vec![], mesh: mesh.mesh.clone() },
        sets: Default::default(),
        weights: vec![],
        metric: vec![],
    };
    out.out.mesh.faces.clear();
    (0..n).for_each(|f| out.face(f));
    let blended = seams.iter().flatten().filter(|s| **s).count() as u64 / 2;
    let plain = out.weights.iter().all(|w| w[0] == 1.0);
    let sets = out.sets.into_iter().take(if plain { 1 } else { 4 }).collect();
    let sets = UvSets { exemplar_size, sets, weights: out.weights, blend, sharpness: 1, material: vec![] };
    Ok(Blended { mesh: out.out, sets, metric: out.metric, blended })
}

/// The place that rules at each corner's vertex, if it is not the corner's own.
struct Rule {
    /// `foreign[3 * face + corner]`: where the vertex lies in the ruling face's place, and the measure of the worst blended
    /// edge there.
    foreign: Vec<Option<(Vec2, [f32; 2])>>,
}

/// The continuity error and length in world units of an edge.
fn measure(mesh: &SynthesisMesh, errors: &[[f32; 3]], f: usize, k: usize) -> [f32; 2] {
    let p = mesh.mesh.corners(f);
    [errors[f][k], (p[(k + 1) % 3] - p[k]).length() as f32]
}

/// The measure of more visibility, the first of equals.
fn worse(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    if b[0] * b[1] > a[0] * a[1] { b } else { a }
}

impl Rule {
    fn new(mesh: &SynthesisMesh, facets: &Facets, at: &[Vec2], errors: &[[f32; 3]], seams: &[[bool; 3]]) -> Self {
        let faces = &mesh.mesh.faces;
        let mut foreign = vec![None; 3 * faces.len()];
        let mut corners: Vec<(u32, u32)> =
            faces.iter().enumerate().flat_map(|(f, v)| (0..3).map(move |i| (v[i], 3 * f as u32 + i as u32))).collect();
        corners.sort_unstable();
        for around in corners.chunk_by(|a, b| a.0 == b.0) {
            let edges = |c: u32| [c as usize % 3, (c as usize + 2) % 3].map(|k| (c as usize / 3, k));
            let blended = around.iter().flat_map(|(_, c)| edges(*c)).filter(|(f, k)| seams[*f][*k]);
            let Some(worst) = blended.map(|(f, k)| measure(mesh, errors, f, k)).reduce(worse) else { continue };
            let position = |c: u32| around.iter().position(|a| a.1 == c);
            // Parts of the faces around: the lowest corner stands for each.
            let mut part: Vec<usize> = (0..around.len()).collect();
            let root = |part: &[usize], mut i: usize| {
                while part[i] != i {
                    i = part[i];
                }
                i
            };
            for (i, &(v, c)) in around.iter().enumerate() {
                for (f, edge) in edges(c) {
                    let Some((g, _)) = facets.opposite(f, edge).filter(|_| !seams[f][edge]) else { continue };
                    let Some(j) = faces[g].iter().position(|w| *w == v) else { continue };
                    if let Some(other) = position(3 * g as u32 + j as u32) {
                        let (a, b) = (root(&part, i), root(&part, other));
                        part[a.max(b)] = a.min(b);
                    }
                }
            }
            let angle = |c: u32| corner_angle(&facets.local[c as usize / 3], c as usize % 3);
            let mut sums = vec![0.0; around.len()];
            (0..around.len()).for_each(|i| sums[root(&part, i)] += angle(around[i].1));
            let ruler = (0..around.len()).fold(0, |best, i| if sums[i] > sums[best] { i } else { best });
            let c = around[ruler].1 as usize;
            let place = at[c / 3] + facets.local[c / 3][c % 3];
            for (i, &(_, c)) in around.iter().enumerate() {
                if root(&part, i) != ruler {
                    foreign[c as usize] = Some((place, worst));
                }
            }
        }
        Rule { foreign }
    }
}

fn corner_angle(local: &[Vec2; 3], k: usize) -> f64 {
    let (a, b) = (local[(k + 1) % 3] - local[k], local[(k + 2) % 3] - local[k]);
    det::atan2(a.cross(b).abs(), a.dot(b))
}

/// A point of a face: a corner, the middle of an edge, or the centre.
#[derive(Clone, Copy, PartialEq)]
enum Point {
    Corner(usize),
    Middle(usize),
    Centre,
}

struct Builder<'a> {
    source: &'a SynthesisMesh,
    facets: &'a Facets,
    at: &'a [Vec2],
    errors: &'a [[f32; 3]],
    seams: &'a [[bool; 3]],
    rule: &'a Rule,
    size: [u32; 2],
    /// Vertices in the middle of edges, once made.
    middles: Vec<[u32; 3]>,
    out: SynthesisMesh,
    sets: [Vec<Texel>; 4],
    weights: Vec<[f32; 4]>,
    metric: Vec<[f32; 2]>,
}

impl Builder<'_> {
    fn face(&mut self, f: usize) {
        use Point::{Centre, Corner, Middle};
        let faces = &self.source.mesh.faces;
        if self.seams[f] == [false; 3] {
            self.triangle(f, faces[f], [Corner(0), Corner(1), Corner(2)], None);
            return;
        }
        let p = self.source.mesh.corners(f);
        let centre = self.vertex((p[0] + p[1] + p[2]) * (1.0 / 3.0));
        for k in 0..3 {
            let (a, b) = (k, (k + 1) % 3);
            if self.seams[f][k] {
                let m = self.middle(f, k, (p[a] + p[b]) * 0.5);
                self.triangle(f, [faces[f][a], m, centre], [Corner(a), Middle(k), Centre], Some(k));
                self.triangle(f, [m, faces[f][b], centre], [Middle(k), Corner(b), Centre], Some(k));
            } else {
                self.triangle(f, [faces[f][a], faces[f][b], centre], [Corner(a), Corner(b), Centre], None);
            }
        }
    }

    fn vertex(&mut self, at: Vec3) -> u32 {
        self.out.mesh.positions.push(at);
        self.out.mesh.positions.len() as u32 - 1
    }

    fn middle(&mut self, f: usize, k: usize, at: Vec3) -> u32 {
        if self.middles[f][k] == u32::MAX {
            let new = self.vertex(at);
            self.middles[f][k] = new;
            if let Some((g, j)) = self.facets.opposite(f, k) {
                self.middles[g][j] = new;
            }
        }
        self.middles[f][k]
    }

    /// One triangle of face `f`; `edge` is the one that it blends over.
    fn triangle(&mut self, f: usize, vertices: [u32; 3], points: [Point; 3], edge: Option<usize>) {
        self.out.mesh.faces.push(vertices);
        self.out.parent.push(self.source.parent[f]);
        let bary = self.source.parent_bary[f];
        let mean = |of: &[usize]| {
            let n = of.len() as f32;
            [0, 1, 2].map(|d| of.iter().map(|c| bary[*c][d]).sum::<f32>() / n)
        };
        self.out.parent_bary.push(points.map(|p| match p {
            Point::Corner(c) => bary[c],
            Point::Middle(k) => mean(&[k.min((k + 1) % 3), k.max((k + 1) % 3)]),
            Point::Centre => mean(&[0, 1, 2]),
        }));
        let own = points.map(|p| self.at[f] + self.local(f, p));
        let across = edge.and_then(|k| self.across(f, k, &points)).unwrap_or(own);
        // Who rules at the triangle's corners, in order; a triangle around the centre has two at most.
        let mut sets = [own, across, own, own];
        let mut weights = [[0.0f32; 4]; 3];
        // A whole face may have three rulers, but then it has no edge to blend over.
        let mut free = if edge.is_none() { 1 } else { 2 };
        let mut metric = [0.0; 2];
        for (i, p) in points.iter().enumerate() {
            match *p {
                Point::Centre => weights[i][0] = 1.0,
                Point::Middle(_) => weights[i] = [0.5, 0.5, 0.0, 0.0],
                Point::Corner(c) => match self.rule.foreign[3 * f + c] {
                    None => weights[i][0] = 1.0,
                    Some((place, worst)) => {
                        metric = worse(metric, worst);
                        sets[free] = points.map(|q| place + self.way_from_corner(f, c, q));
                        weights[i][free] = 1.0;
                        free += 1;
                    }
                },
            }
        }
        let [w, h] = self.size.map(|s| s as f32 - 0.5);
        for (set, places) in self.sets.iter_mut().zip(sets) {
            set.extend(places.map(|p| texel((p.x as f32).clamp(0.5, w), (p.y as f32).clamp(0.5, h))));
        }
        self.weights.extend(weights);
        let metric = edge.map_or(metric, |k| measure(self.source, self.errors, f, k));
        self.metric.extend([metric; 3]);
    }

    /// Where a point lies in the face's texture space.
    fn local(&self, f: usize, p: Point) -> Vec2 {
        let l = &self.facets.local[f];
        match p {
            Point::Corner(c) => l[c],
            Point::Middle(k) => self.facets.middle(f, k),
            Point::Centre => (l[0] + l[1] + l[2]) * (1.0 / 3.0),
        }
    }

    /// Where points of a face lie in the place across an edge, unfolded over it.
    fn across(&self, f: usize, k: usize, points: &[Point; 3]) -> Option<[Vec2; 3]> {
        let (g, j) = self.facets.opposite(f, k)?;
        let (sin, cos) = det::sin_cos(self.facets.turn(f, k));
        let (here, there) = (self.facets.middle(f, k), self.at[g] + self.facets.middle(g, j));
        let [d, c] = self.facets.edge(g, j);
        Some(points.map(|p| {
            // Exactly what the face beyond shows on the edge.
            if p == Point::Corner(k) {
                return self.at[g] + c;
            } else if p == Point::Corner((k + 1) % 3) {
                return self.at[g] + d;
            }
            let o = self.local(f, p) - here;
            there + vec2(o.x * cos - o.y * sin, o.x * sin + o.y * cos)
        }))
    }

    /// The way from a corner of a face, at whose vertex another place rules, to another of its points. Along edges both
    /// faces agree: it is the way of the face beyond if that shows its own place there, else the mean of both; towards the
    /// centre it is the face's own.
    fn way_from_corner(&self, f: usize, c: usize, to: Point) -> Vec2 {
        let own = |p: Point| self.local(f, p) - self.facets.local[f][c];
        let along = |end: usize| {
            // Edge c starts at the corner, the one at `end` ends there.
            let starts = end == (c + 1) % 3;
            let k = if starts { c } else { end };
            let way = own(Point::Corner(end));
            let Some((g, j)) = self.facets.opposite(f, k) else { return way };
            // Their edge runs against ours.
            let ([d, e], at) = (self.facets.edge(g, j), if starts { (j + 1) % 3 } else { j });
            let theirs = if starts { d - e } else { e - d };
            let is_sharp = self.facets.turn(f, k).abs() > SHARP_TURN;
            if self.rule.foreign[3 * g + at].is_none() || (is_sharp && g < f) {
                theirs
            } else if is_sharp {
                way
            } else {
                (way + theirs) * 0.5
            }
        };
        match to {
            Point::Corner(end) if end == c => Vec2::ZERO,
            Point::Corner(end) => along(end),
            Point::Middle(k) if k == c => along((c + 1) % 3) * 0.5,
            Point::Middle(k) if (k + 1) % 3 == c => along(k) * 0.5,
            p => own(p),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{Field, Symmetry};
    use crate::mesh::{Topology, TriMesh, check::census, zoo};
    use crate::numerics::rng::Key;

    fn laid(m: &TriMesh, scale: f32) -> (SynthesisMesh, Facets, Vec<Vec2>) {
        let up = m.vertex_normals().iter().map(|n| n.any_perpendicular()).collect();
        let facets = Facets::new(m, &Field { up, scale: vec![scale; m.positions.len()] }, Symmetry::One);
        let corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let n = m.faces.len();
        let mesh = SynthesisMesh { mesh: m.clone(), parent: (0..n as u32).collect(), parent_bary: vec![corners; n] };
        let key = Key::new(9);
        let at =
            (0..n as u64).map(|f| vec2(30.0 + 40.0 * key.with(f).unit(0), 30.0 + 40.0 * key.with(f).unit(1))).collect();
        (mesh, facets, at)
    }

    /// A smooth texture at a point of a triangle.
    fn shown(b: &Blended, face: usize, bary: [f32; 3]) -> f64 {
        let weights = b.sets.weights_at(face, bary);
        let value = |s: usize| {
            let t = b.sets.at(s, face, bary);
            det::sin(f64::from(t.x) * 0.3) + det::sin(f64::from(t.y) * 0.2)
        };
        (0..b.sets.sets.len()).map(|s| f64::from(weights[s]) * value(s)).sum()
    }

    #[test]
    fn the_blend_is_continuous_across_edges() {
        for (name, m) in zoo::all() {
            let (mesh, facets, at) = laid(&m, 6.0);
            let b =
                blend_edges(&mesh, &facets, &at, &vec![[1.0; 3]; at.len()], 0.1, [100, 100], Blend::Linear).unwrap();
            let all = Facets::new(
                &b.mesh.mesh,
                &Field {
                    up: vec![crate::numerics::vec::vec3(0.0, 0.0, 1.0); b.mesh.mesh.positions.len()],
                    scale: vec![1.0; b.mesh.mesh.positions.len()],
                },
                Symmetry::One,
            );
            for f in 0..all.len() {
                for k in 0..3 {
                    let Some((g, j)) = all.opposite(f, k) else { continue };
                    for t in [0.0f32, 0.3, 0.8, 1.0] {
                        let (mut p, mut q) = ([0.0; 3], [0.0; 3]);
                        (p[k], p[(k + 1) % 3]) = (1.0 - t, t);
                        (q[j], q[(j + 1) % 3]) = (t, 1.0 - t);
                        let (x, y) = (shown(&b, f, p), shown(&b, g, q));
                        assert!((x - y).abs() < 1e-3, "{name} {f} {k} {t}: {x} {y}");
                    }
                }
            }
        }
    }

    #[test]
    fn dividing_keeps_the_surface() {
        for (name, m) in zoo::all() {
            let (mesh, facets, at) = laid(&m, 6.0);
            let error = |f: usize, k: usize| {
                let (a, b) = (m.faces[f][k], m.faces[f][(k + 1) % 3]);
                Key::new(3).with(u64::from(a.min(b))).unit(u64::from(a.max(b))) as f32
            };
            let errors: Vec<[f32; 3]> = (0..at.len()).map(|f| [0, 1, 2].map(|k| error(f, k))).collect();
            let b = blend_edges(&mesh, &facets, &at, &errors, 0.5, [100, 100], Blend::Linear).unwrap();
            let (before, after) = (census(&m, &Topology::new(&m)), census(&b.mesh.mesh, &Topology::new(&b.mesh.mesh)));
            assert_eq!((before.components, before.euler), (after.components, after.euler), "{name}");
            let area = |m: &TriMesh| (0..m.faces.len()).map(|f| m.area(f)).sum::<f64>();
            assert!((area(&m) - area(&b.mesh.mesh)).abs() < 1e-9 * (1.0 + area(&m)), "{name}");
            for (f, (parent, bary)) in b.mesh.parent.iter().zip(&b.mesh.parent_bary).enumerate() {
                let p = m.corners(*parent as usize);
                for (c, b3) in bary.iter().enumerate() {
                    let want = p[0] * f64::from(b3[0]) + p[1] * f64::from(b3[1]) + p[2] * f64::from(b3[2]);
                    assert!((want - b.mesh.mesh.corners(f)[c]).length() < 1e-5, "{name}");
                }
            }
            assert!(b.sets.weights.iter().all(|w| (w.iter().sum::<f32>() - 1.0).abs() < 1e-6), "{name}");
        }
    }

    #[test]
    fn set_0_and_the_one_across_are_similar_to_their_triangles() {
        let (mesh, facets, at) = laid(&zoo::torus(9, 7), 3.0);
        let b = blend_edges(&mesh, &facets, &at, &vec![[1.0; 3]; at.len()], 0.0, [100, 100], Blend::Linear).unwrap();
        for f in 0..b.mesh.mesh.faces.len() {
            let p = b.mesh.mesh.corners(f);
            for set in &b.sets.sets[..2] {
                for k in 0..3 {
                    let (x, y) = (set[3 * f + k], set[3 * f + (k + 1) % 3]);
                    let flat = f64::from((x.x - y.x) * (x.x - y.x) + (x.y - y.y) * (x.y - y.y)).sqrt();
                    let real = (p[k] - p[(k + 1) % 3]).length() * 3.0;
                    assert!((flat - real).abs() < 1e-3 * (1.0 + real), "{f}: {flat} {real}");
                }
            }
        }
    }

    #[test]
    fn without_errors_or_blending_there_is_one_set() {
        let (mesh, facets, at) = laid(&zoo::torus(9, 7), 3.0);
        let b = |errors: f32, blend| {
            blend_edges(&mesh, &facets, &at, &vec![[errors; 3]; at.len()], 0.5, [100, 100], blend).unwrap()
        };
        for b in [b(0.0, Blend::Linear), b(1.0, Blend::Nearest)] {
            assert_eq!((b.sets.sets.len(), &b.mesh, b.blended), (1, &mesh, 0));
        }
        let bad = blend_edges(&mesh, &facets, &at, &[], 0.5, [100, 100], Blend::Linear).unwrap_err();
        assert!(bad.to_string().contains("0 errors of faces"), "{bad}");
        let bad = blend_edges(&mesh, &facets, &at, &vec![[0.0; 3]; at.len()], f32::NAN, [100, 100], Blend::Linear);
        assert_eq!(bad.unwrap_err().to_string(), "a blend threshold of NaN: expected a number of at least 0");
    }
}
