//! Sites: vertices about equally far apart in texels, on which a surface is synthesised whatever its triangles are like.
//!
//! \[ZG03\] walks over all vertices, which ties the size of patches (a vertex jumps with a chance proportional to the
//! length of its edges, so twice as many vertices along an edge make twice as many jumps in an area) and the width of
//! the blend (one ring of triangles) to the mesh. Its section 4.4 asks for more where triangles are small: "it may be
//! necessary to blend boundaries over multiple triangles". Here the walk visits only the sites, no two of which are
//! nearer than `spacing` texels, and each site's patch is laid out over the vertices around it along shortest paths, as
//! far as it weighs anything. Weights are those of a smoothed Voronoi diagram: one where the site is the nearest,
//! falling linearly with the surplus distance, zero at a surplus of `spacing`; so they vanish at every other site and
//! between two sites they are about the linear ramp of \[ZG03\] 4.4. Where all edges are longer than `spacing` every
//! vertex is a site, and the method is the published one.
//!
//! Distances are lengths of the offset from the site, summed along the path shortest in texels (Dijkstra).
//! Unaware of: positions, addresses, how offsets were made.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::mesh::Topology;
use crate::numerics::par;
use crate::numerics::vec::{Vec2, vec2};

/// Paths longer than this many times what they lead to are not followed: they go round something.
const LONGEST: f64 = 1.6;

/// Sites, how they adjoin and what each reaches.
#[derive(Clone, Debug)]
pub struct Sites {
    /// The vertex that each site is, ascending.
    pub vertices: Vec<u32>,
    /// Which sites adjoin: those between whose nearest vertices there is an edge. It has no faces.
    pub topology: Topology,
    /// Offset of each half-edge of `topology` in texels, in the frame of the site that it starts from.
    pub offsets: Vec<Vec2>,
    /// Least and greatest corner of what is laid out from each site, offsets from its address.
    pub boxes: Vec<[Vec2; 2]>,
    /// Where the reaches of each vertex start, and where those without weight.
    starts: Vec<[u32; 2]>,
    reaches: Vec<Reach>,
}

/// A vertex as a site sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reach {
    pub site: u32,
    /// Offset from the site to the vertex, in the site's frame.
    pub offset: [f32; 2],
    /// One where the site is the nearest; zero where it only must be known, at corners of faces that it reaches into.
    pub weight: f32,
}

/// A mesh's edges as offsets.
#[derive(Clone, Copy)]
struct Net<'a> {
    topology: &'a Topology,
    offsets: &'a [Vec2],
    /// Their lengths.
    lengths: &'a [f64],
    /// Whether frames may be quarter turns apart (fields of 2-way and 4-way symmetry).
    turned: bool,
}

impl Net<'_> {
    /// Quarter turns that take a vector from the frame of half-edge `h`'s target to that of `v`, where it starts.
    fn turns(&self, v: u32, h: usize) -> u8 {
        if !self.turned {
            return 0;
        }
        let Some(back) = self.topology.find(self.topology.target(h), v) else { return 0 };
        let (there, back) = (self.offsets[h], -self.offsets[back]);
        (0..4).find(|q| quarters(back, *q) == there).unwrap_or(0)
    }
}

/// A vector after so many quarter turns, as `field::edge_offsets` turns them: right becomes up.
fn quarters(d: Vec2, q: u8) -> Vec2 {
    (0..q % 4).fold(d, |d, _| vec2(d.y, -d.x))
}

/// A vertex as the spreading from a site sees it.
#[derive(Clone, Copy)]
struct Label {
    vertex: u32,
    /// Quarter turns that take a vector from the vertex's frame to the site's.
    turns: u8,
    settled: bool,
    /// Texels along the path.
    length: f64,
    /// Offset from the site.
    at: Vec2,
    /// Zero where paths are not followed any further.
    weight: f32,
}

/// Shortest paths from one vertex at a time; memory kept from one to the next.
struct Spread<'a> {
    net: Net<'a>,
    /// Index in `seen` of each vertex.
    slots: Vec<u32>,
    seen: Vec<Label>,
    heap: BinaryHeap<Reverse<(u64, u32)>>,
}

const NONE: u32 = u32::MAX;

impl<'a> Spread<'a> {
    fn new(net: Net<'a>) -> Self {
        let slots = vec![NONE; net.topology.vertex_count()];
        Spread { net, slots, seen: vec![], heap: BinaryHeap::new() }
    }

    /// Labels `start`, all vertices that paths through vertices of positive weight lead to, and their neighbours. A
    /// vertex beyond `limit`, or of longer paths than that allows, has no weight.
    fn from(&mut self, start: u32, limit: f64, weigh: impl Fn(u32, f64) -> f64) {
        for label in self.seen.drain(..) {
            self.slots[label.vertex as usize] = NONE;
        }
        let weight = |vertex: u32, at: Vec2, length: f64| {
            let distance = at.length();
            let within = distance < limit && length <= LONGEST * limit;
            if within { weigh(vertex, distance).max(0.0) as f32 } else { 0.0 }
        };
        let first = weight(start, Vec2::ZERO, 0.0);
        self.offer(Label { vertex: start, turns: 0, settled: false, length: 0.0, at: Vec2::ZERO, weight: first });
        while let Some(Reverse((_, slot))) = self.heap.pop() {
            let label = &mut self.seen[slot as usize];
            if std::mem::replace(&mut label.settled, true) {
                continue;
            }
            let label = *label;
            let Net { topology, offsets, lengths, .. } = self.net;
            for h in topology.half_edges(label.vertex) {
                let (vertex, length) = (topology.target(h), label.length + lengths[h]);
                let slot = self.slots[vertex as usize];
                if slot != NONE && self.seen[slot as usize].length <= length {
                    continue;
                }
                let at = label.at + quarters(offsets[h], label.turns);
                let turns = (label.turns + self.net.turns(label.vertex, h)) % 4;
                let weight = weight(vertex, at, length);
                self.offer(Label { vertex, turns, settled: false, length, at, weight });
            }
        }
    }

    /// Takes in a label that is the vertex's first or better than its last. One without weight is settled: no path goes
    /// on from it.
    fn offer(&mut self, label: Label) {
        let label = Label { settled: label.weight <= 0.0, ..label };
        let slot = &mut self.slots[label.vertex as usize];
        if *slot == NONE {
            *slot = self.seen.len() as u32;
            self.seen.push(label);
        } else {
            self.seen[*slot as usize] = label;
        }
        if !label.settled {
            // The bits of numbers that are not negative are in the numbers' order.
            self.heap.push(Reverse((label.length.to_bits(), *slot)));
        }
    }
}

/// The site nearest to a vertex.
#[derive(Clone, Copy)]
struct Nearest {
    site: u32,
    turns: u8,
    /// Offset from the site.
    at: Vec2,
    distance: f64,
}

/// The nearest sites of all vertices, their distances, and how far sites are apart.
#[derive(Clone, Copy)]
struct Near<'a> {
    nearest: &'a [Nearest],
    distances: &'a [f64],
    spacing: f64,
}

/// What some sites come to, one after the other.
#[derive(Default)]
struct Laid {
    /// Adjoining sites and the offsets to them, ascending for each site, and how many each has.
    beside: Vec<(u32, Vec2)>,
    degrees: Vec<u32>,
    /// Vertices that are reached.
    reaches: Vec<(u32, Reach)>,
    /// Least and greatest corner of what each lays out.
    extents: Vec<[Vec2; 2]>,
    /// The best path to each site beside the one at hand; scratch memory.
    paths: Vec<Path>,
}

impl Reach {
    fn new(site: u32, at: Vec2, weight: f32) -> Self {
        Reach { site, offset: [at.x as f32, at.y as f32], weight }
    }
}

/// The least box that holds another and a point.
fn extended([low, high]: [Vec2; 2], at: Vec2) -> [Vec2; 2] {
    [vec2(low.x.min(at.x), low.y.min(at.y)), vec2(high.x.max(at.x), high.y.max(at.y))]
}

impl Sites {
    /// Chooses sites `spacing` texels apart; `None` if every vertex would be one.
    ///
    /// `offsets` as for the walk, finite; `turned`: whether frames may be quarter turns apart. Vertices are taken in order
    /// of index unless a site is nearer than `spacing`.
    pub fn new(topology: &Topology, offsets: &[Vec2], spacing: f64, turned: bool) -> Option<Sites> {
        let lengths: Vec<f64> = offsets.iter().map(|o| o.length()).collect();
        let net = Net { topology, offsets, lengths: &lengths, turned };
        let (vertices, nearest) = choose(net, spacing);
        if vertices.len() == topology.vertex_count() {
            return None;
        }
        // By themselves: they are asked for all the time, the rest of `nearest` is not.
        let distances: Vec<f64> = nearest.iter().map(|n| n.distance).collect();
        let near = Near { nearest: &nearest, distances: &distances, spacing };
        // Few large chunks: each has an array of all vertices.
        let laid = par::map_chunks(vertices.len(), vertices.len().div_ceil(16).max(64), |some| {
            let (mut spread, mut laid) = (Spread::new(net), Laid::default());
            // Two rings, where all vertices are sites.
            laid.reaches.reserve(20 * some.len());
            laid.beside.reserve(6 * some.len());
            some.for_each(|s| laid.lay(&mut spread, s as u32, vertices[s], near));
            laid
        });
        Some(assemble(vertices, &laid, &nearest))
    }

    /// The sites in the order in which `order` first comes to a vertex next to each.
    pub fn in_order_of(&self, order: &[u32]) -> Vec<u32> {
        let mut taken = vec![false; self.vertices.len()];
        let mut sites = Vec::with_capacity(taken.len());
        for v in order {
            // The nearest has weight one.
            if let Some(r) =
                self.reaching(*v).0.iter().max_by(|a, b| a.weight.total_cmp(&b.weight).then(b.site.cmp(&a.site)))
                && !std::mem::replace(&mut taken[r.site as usize], true)
            {
                sites.push(r.site);
            }
        }
        sites
    }

    /// The sites that weigh something at a vertex, and those whose place there is only known; both ascending.
    pub(super) fn reaching(&self, v: u32) -> (&[Reach], &[Reach]) {
        let ([first, known], [end, _]) = (self.starts[v as usize], self.starts[v as usize + 1]);
        (&self.reaches[first as usize..known as usize], &self.reaches[known as usize..end as usize])
    }
}

/// The sites' vertices, and the nearest site of every vertex.
fn choose(net: Net, spacing: f64) -> (Vec<u32>, Vec<Nearest>) {
    let none = Nearest { site: NONE, turns: 0, at: Vec2::ZERO, distance: f64::INFINITY };
    let mut nearest = vec![none; net.topology.vertex_count()];
    let mut spread = Spread::new(net);
    let mut vertices = vec![];
    for v in 0..nearest.len() as u32 {
        if nearest[v as usize].site != NONE {
            continue;
        }
        spread.from(v, spacing, |_, _| 1.0);
        for label in spread.seen.iter().filter(|l| l.weight > 0.0) {
            let known = &mut nearest[label.vertex as usize];
            let distance = label.at.length();
            if distance < known.distance {
                *known = Nearest { site: vertices.len() as u32, turns: label.turns, at: label.at, distance };
            }
        }
        vertices.push(v);
    }
    (vertices, nearest)
}

impl Laid {
    /// Lays out the patch of a site.
    fn lay(&mut self, spread: &mut Spread, site: u32, vertex: u32, near: Near) {
        let Near { nearest, distances, spacing } = near;
        // Nobody is further than `spacing` from a site, so weights end before twice that.
        spread.from(vertex, 2.0 * spacing, |v, distance| 1.0 - (distance - distances[v as usize]).max(0.0) / spacing);
        let topology = spread.net.topology;
        let mut extent = [Vec2::ZERO; 2];
        self.paths.clear();
        // Those without weight are corners of faces that it reaches into.
        for &Label { vertex: v, at, weight, .. } in &spread.seen {
            self.reaches.push((v, Reach::new(site, at, weight)));
            extent = extended(extent, at);
            if nearest[v as usize].site == site {
                topology
                    .half_edges(v)
                    .filter_map(|h| path(spread.net, site, v, h, nearest))
                    .for_each(|p| self.offer(p));
            }
        }
        self.paths.sort_unstable_by_key(|p| p.0);
        self.beside.extend(self.paths.iter().map(|p| (p.0, p.4)));
        self.degrees.push(self.paths.len() as u32);
        self.extents.push(extent);
    }

    /// Keeps a path if it is the best to where it leads: the shortest, of equals the one over the first edge.
    fn offer(&mut self, path: Path) {
        let order = |p: &Path, q: &Path| p.1.total_cmp(&q.1).then((p.2, p.3).cmp(&(q.2, q.3)));
        match self.paths.iter_mut().find(|p| p.0 == path.0) {
            None => self.paths.push(path),
            Some(known) if order(&path, known).is_lt() => *known = path,
            Some(_) => {}
        }
    }
}

/// A path to another site: that site, the path's length, the ends in order of the edge that leads over, the offset.
type Path = (u32, f64, u32, u32, Vec2);

/// The path from a site over half-edge `h` of a vertex `v` nearest to it to the site next to the target, if that is
/// another.
fn path(net: Net, site: u32, v: u32, h: usize, nearest: &[Nearest]) -> Option<Path> {
    let w = net.topology.target(h);
    let (from, to, d) = (&nearest[v as usize], &nearest[w as usize], net.offsets[h]);
    if to.site == site {
        return None;
    }
    let length = (from.distance + to.distance) + net.lengths[h];
    let offset = if net.turned {
        // What leads from `w` to its site, turned into the frame of `w`, then into ours.
        let back = quarters(-to.at, 4 - to.turns);
        from.at + quarters(d, from.turns) + quarters(back, from.turns + net.turns(v, h))
    } else if site < to.site {
        from.at + d - to.at
    } else {
        // Rounded as the other half is, so that the two are exact opposites.
        -(to.at - d - from.at)
    };
    Some((to.site, length, v.min(w), v.max(w), offset))
}

fn assemble(vertices: Vec<u32>, laid: &[Laid], nearest: &[Nearest]) -> Sites {
    let flat = || laid.iter().flat_map(|l| &l.beside);
    let mut site_starts = vec![0u32];
    for degree in laid.iter().flat_map(|l| &l.degrees) {
        site_starts.push(site_starts[site_starts.len() - 1] + degree);
    }
    let topology = Topology::from_rows(site_starts, flat().map(|b| b.0).collect());
    let offsets = flat().map(|b| b.1).collect();
    let mut boxes: Vec<[Vec2; 2]> = laid.iter().flat_map(|l| &l.extents).copied().collect();
    // Every vertex has a site, even where offsets make no sense as a surface: its nearest, instead of what that says.
    let all = || laid.iter().flat_map(|l| &l.reaches).map(|(v, r)| (*v as usize, r));
    let mut counts = vec![[0u32; 2]; nearest.len()];
    all().for_each(|(v, r)| counts[v][usize::from(r.weight <= 0.0)] += 1);
    let lost: Vec<usize> = (0..nearest.len()).filter(|v| counts[*v][0] == 0).collect();
    let mut own = vec![];
    for v in lost {
        let Nearest { site, at, .. } = nearest[v];
        own.push((v, Reach::new(site, at, 1.0)));
        boxes[site as usize] = extended(boxes[site as usize], at);
        counts[v] = [1, counts[v][1]];
    }
    let mut starts = vec![[0u32; 2]; nearest.len() + 1];
    for (v, [some, known]) in counts.iter().enumerate() {
        starts[v][1] = starts[v][0] + some;
        starts[v + 1][0] = starts[v][1] + known;
    }
    let mut fill = starts.clone();
    let mut reaches = vec![Reach::new(NONE, Vec2::ZERO, 0.0); starts[nearest.len()][0] as usize];
    for (v, r) in all().chain(own.iter().map(|(v, r)| (*v, r))) {
        let at = &mut fill[v][usize::from(r.weight <= 0.0)];
        reaches[*at as usize] = *r;
        *at += 1;
    }
    Sites { vertices, topology, offsets, boxes, starts, reaches }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriMesh;
    use crate::synth::testing::{flat_offsets, grid, random_offsets, topologies};

    fn flat(w: u32, h: u32, scale: f64) -> (TriMesh, Topology, Vec<Vec2>) {
        let mesh = grid(w, h, 0.3);
        let t = Topology::new(&mesh);
        let offsets = flat_offsets(&mesh, &t, scale);
        (mesh, t, offsets)
    }

    #[test]
    fn where_edges_are_long_every_vertex_is_a_site() {
        let (_, t, offsets) = flat(12, 9, 8.0);
        assert!(Sites::new(&t, &offsets, 3.0, false).is_none());
        assert!(Sites::new(&t, &offsets, 9.0, false).is_some());
    }

    #[test]
    fn on_a_plane_everything_is_where_it_is() {
        let (mesh, t, offsets) = flat(60, 50, 0.7);
        let spacing = 4.0;
        let sites = Sites::new(&t, &offsets, spacing, false).unwrap();
        let between = |a: u32, b: u32| (mesh.positions[b as usize] - mesh.positions[a as usize]) * 0.7;
        for (i, a) in sites.vertices.iter().enumerate() {
            assert!(sites.vertices[..i].iter().all(|b| between(*a, *b).length() >= spacing));
            for h in sites.topology.half_edges(i as u32) {
                let d = between(*a, sites.vertices[sites.topology.target(h) as usize]);
                assert!((d.x - sites.offsets[h].x).abs() + (d.y - sites.offsets[h].y).abs() < 1e-9);
                assert!(d.length() < 3.0 * spacing);
                let back = sites.topology.find(sites.topology.target(h), i as u32).unwrap();
                assert_eq!(sites.offsets[back], -sites.offsets[h]);
            }
        }
        for v in 0..t.vertex_count() as u32 {
            let reaching = [sites.reaching(v).0, sites.reaching(v).1].concat();
            assert!(
                sites.reaching(v).0.is_sorted_by_key(|r| r.site) && sites.reaching(v).1.is_sorted_by_key(|r| r.site)
            );
            let distances = sites.vertices.iter().map(|s| between(*s, v).length());
            let nearest = distances.fold(f64::INFINITY, f64::min);
            assert!(nearest < spacing);
            for r in &reaching {
                let d = between(sites.vertices[r.site as usize], v);
                assert!((d.x as f32 - r.offset[0]).abs() + (d.y as f32 - r.offset[1]).abs() < 1e-4);
                let weight = (1.0 - (d.length() - nearest) / spacing).max(0.0);
                assert!((f64::from(r.weight) - weight).abs() < 1e-5, "{} {weight}", r.weight);
                let [low, high] = sites.boxes[r.site as usize];
                assert!(low.x <= d.x + 1e-9 && d.x <= high.x + 1e-9 && low.y <= d.y + 1e-9 && d.y <= high.y + 1e-9);
            }
            assert!(reaching.iter().any(|r| r.weight == 1.0));
        }
        // All is there for the corners of faces that a site reaches into.
        for face in &mesh.faces {
            for r in face.iter().flat_map(|v| sites.reaching(*v).0) {
                let knows = |(some, known): (&[Reach], &[Reach])| some.iter().chain(known).any(|o| o.site == r.site);
                assert!(face.iter().all(|v| knows(sites.reaching(*v))));
            }
        }
    }

    /// The number of sites, and with it the size of patches, is the surface's, not the mesh's.
    #[test]
    fn finer_meshes_have_as_many_sites() {
        let coarse = flat(40, 40, 2.0);
        let fine = flat(157, 157, 0.5);
        let count = |(_, t, offsets): &(TriMesh, Topology, Vec<Vec2>)| {
            Sites::new(t, offsets, 6.0, false).unwrap().vertices.len() as f64
        };
        let (a, b) = (count(&coarse), count(&fine));
        assert!((a / b - 1.0).abs() < 0.2, "{a} {b}");
    }

    #[test]
    fn any_mesh_and_any_offsets_have_sites() {
        for (name, t) in topologies() {
            for reach in [0.0, 0.4, 3.0] {
                let offsets = random_offsets(&t, reach, 3);
                let Some(sites) = Sites::new(&t, &offsets, 2.0, false) else { continue };
                for v in 0..t.vertex_count() as u32 {
                    let (some, known) = sites.reaching(v);
                    assert!(!some.is_empty() && some.iter().all(|r| r.weight > 0.0), "{name}");
                    assert!(known.iter().all(|r| r.weight <= 0.0), "{name}");
                    assert!(some.is_sorted_by_key(|r| r.site) && known.is_sorted_by_key(|r| r.site), "{name}");
                }
                let order = sites.in_order_of(&(0..t.vertex_count() as u32).collect::<Vec<_>>());
                assert_eq!(order.len(), sites.vertices.len(), "{name}");
                for (i, s) in sites.vertices.iter().enumerate() {
                    assert!(sites.topology.neighbours(i as u32).iter().all(|n| *n as usize != i), "{name} {s}");
                }
            }
        }
    }

    /// A plane whose right half has its frames turned by a quarter looks the same to every site as one without.
    #[test]
    fn turned_frames_are_turned_back() {
        let (mesh, t, offsets) = flat(30, 20, 0.8);
        let is_turned = |v: u32| mesh.positions[v as usize].x > 15.0;
        let turned: Vec<Vec2> = (0..t.vertex_count() as u32)
            .flat_map(|v| t.half_edges(v).map(move |h| (v, h)))
            .map(|(v, h)| quarters(offsets[h], u8::from(is_turned(v))))
            .collect();
        let plain = Sites::new(&t, &offsets, 4.0, false).unwrap();
        let sites = Sites::new(&t, &turned, 4.0, true).unwrap();
        assert_eq!(plain.vertices, sites.vertices);
        for (s, v) in sites.vertices.iter().enumerate() {
            for h in plain.topology.half_edges(s as u32) {
                let back = quarters(sites.offsets[h], 4 - u8::from(is_turned(*v)));
                assert!((back - plain.offsets[h]).length() < 1e-9);
            }
        }
        for v in 0..t.vertex_count() as u32 {
            let all = |s: &Sites| [s.reaching(v).0, s.reaching(v).1].concat();
            for (a, b) in all(&plain).iter().zip(&all(&sites)) {
                let q = u8::from(is_turned(sites.vertices[b.site as usize]));
                let back = quarters(vec2(b.offset[0].into(), b.offset[1].into()), 4 - q);
                assert!((a.site, a.weight) == (b.site, b.weight));
                assert!((back - vec2(a.offset[0].into(), a.offset[1].into())).length() < 1e-4);
            }
        }
    }
}
