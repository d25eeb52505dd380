//! Surface to synthesis mesh: weld, drop what has no area, part two-sided sheets, subdivide what is too large.
//!
//! In: a [`Surface`], any triangles. Out: a [`SynthesisMesh`] whose every vertex has a face, and whose 1-rings fit into
//! the exemplar (`[ZG03]` section 1: remeshing is needed only "if triangles of the surface do not fit entirely within
//! texture space", and section 4.2.4: the whole 1-ring must). Non-manifold input goes through as it is.
//! Unaware of: orientation, what is in the exemplar, files.

use std::fmt;

use super::{Surface, SynthesisMesh, TriMesh, sheets, subdivide, weld};
use crate::numerics::vec::Vec3;

/// Vertices closer than this share of the bounding box's diagonal are one: about the rounding of f32 coordinates.
/// Faces of less height have no area.
pub const WELD_TOLERANCE: f64 = 1e-7;
/// Largest magnitude of a coordinate; squares of areas stay far from overflow.
pub const COORDINATE_LIMIT: f64 = 1e30;

/// What [`prepare`] needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrepareParams {
    /// Texels per world unit, positive; where it varies, the greatest.
    pub scale: f64,
    /// Width and height of the exemplar in texels.
    pub exemplar_size: [u32; 2],
    /// The part of the shorter exemplar side that one edge may take, 0 < share <= 0.5. At 0.25 a 1-ring takes at most
    /// half a side, which leaves half of the addresses valid (\[ZG03\] 4.2.4). Shorter is better: patches are blended
    /// over one edge, and a jump promises alike texels only about as far as the neighbourhoods reach.
    pub max_span_share: f64,
    /// Most faces of the result.
    pub face_limit: u32,
}

impl PrepareParams {
    /// A share of a sixteenth and a limit of 20 million faces.
    pub fn new(scale: f64, exemplar_size: [u32; 2]) -> Self {
        PrepareParams { scale, exemplar_size, max_span_share: 0.0625, face_limit: 20_000_000 }
    }

    /// The longest edge in world units.
    pub fn max_edge(&self) -> f64 {
        self.max_span_share * f64::from(self.exemplar_size[0].min(self.exemplar_size[1])) / self.scale
    }
}

/// Why a surface cannot be prepared.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// The scale is not a positive finite number.
    Scale(f64),
    /// A side of the exemplar is 0.
    ExemplarSize([u32; 2]),
    /// The span share is outside its range.
    SpanShare(f64),
    /// A face refers to a vertex that is not there.
    Index {
        /// The face.
        face: usize,
        /// The index it has.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A coordinate is NaN, infinite or too large.
    Position {
        /// The vertex.
        vertex: usize,
        /// Where it is.
        at: Vec3,
    },
    /// There are no faces, or all are without area.
    NoArea {
        /// Number of faces, none of them with an area.
        faces: usize,
    },
    /// The surface has too many faces before any subdivision.
    TooManyInputFaces {
        /// Faces there are.
        faces: usize,
        /// The limit.
        limit: u32,
    },
    /// Subdivision would give too many faces.
    TooManyFaces {
        /// About so many are needed.
        needed: f64,
        /// The limit.
        limit: u32,
        /// The scale asked for, texels per world unit.
        scale: f64,
        /// A scale that fits.
        fits: f64,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Scale(s) => write!(f, "the scale is {s} texels per unit; it must be a positive number"),
            Error::ExemplarSize([w, h]) => write!(f, "the exemplar is {w} x {h} texels; it needs at least one"),
            Error::SpanShare(s) => write!(f, "an edge may take {s} of the exemplar; the share must be in 0 < s <= 0.5"),
            Error::Index { face, index, vertices } => {
                write!(f, "face {face} uses vertex {index}, but there are {vertices} vertices")
            }
            Error::Position { vertex, at } => write!(
                f,
                "vertex {vertex} is at ({}, {}, {}); coordinates must be numbers of magnitude at most \
                 {COORDINATE_LIMIT:e}",
                at.x, at.y, at.z
            ),
            Error::NoArea { faces: 0 } => write!(f, "the mesh has no triangles"),
            Error::NoArea { faces } => write!(f, "none of the mesh's {faces} triangles has an area"),
            Error::TooManyInputFaces { faces, limit } => {
                write!(f, "the mesh has {faces} triangles, more than the limit of {limit}")
            }
            Error::TooManyFaces { needed, limit, scale, fits } => write!(
                f,
                "at a scale of {scale} texels per unit the mesh would be subdivided into about {} triangles, more than \
                 the limit of {limit}; a scale of {} fits (or a larger exemplar, or a smaller mesh)",
                rounded(*needed),
                plain(*fits)
            ),
        }
    }
}

impl std::error::Error for Error {}

/// A large number to two digits, in plain words.
fn rounded(n: f64) -> String {
    match n {
        n if n >= 1e15 => format!("{n:.1e}"),
        n if n >= 1e9 => format!("{:.1} thousand million", n / 1e9),
        n => format!("{:.1} million", n / 1e6),
    }
}

/// A number of three digits without the noise of its binary form.
fn plain(x: f64) -> String {
    if (1e-3..1e15).contains(&x) { format!("{}", (x * 1e6).round() / 1e6) } else { format!("{x:.2e}") }
}

/// Makes the synthesis mesh of a surface.
///
/// 1. Weld: vertices within 1e-7 of the bounding box's diagonal become the lowest of them, where it is.
/// 2. Drop faces that have two equal corners now, or a height within that tolerance (no direction can be trusted).
/// 3. Part the two sides of sheets whose faces come in both windings.
/// 4. Drop vertices without a face; those left keep their order.
/// 5. Halve edges longer than [`PrepareParams::max_edge`], without cracks.
///
/// Faces keep the order of their parents. The number of faces is found before memory is taken.
pub fn prepare(surface: &Surface, params: &PrepareParams) -> Result<SynthesisMesh, Error> {
    validate(params)?;
    let input = &surface.mesh;
    let (used, low, diagonal) = extent(input)?;
    let tolerance = diagonal * WELD_TOLERANCE;
    let target = if tolerance > 0.0 {
        weld::weld(&input.positions, &used, low, tolerance)
    } else {
        return Err(Error::NoArea { faces: input.faces.len() });
    };

    let (mut faces, mut parent) = (vec![], vec![]);
    for (f, face) in input.faces.iter().enumerate() {
        let face = face.map(|v| target[v as usize]);
        if has_height(face.map(|v| input.positions[v as usize]), tolerance) {
            faces.push(face);
            parent.push(f as u32);
        }
    }
    if faces.is_empty() {
        return Err(Error::NoArea { faces: input.faces.len() });
    }
    let mut copied = vec![];
    sheets::part_sides(&mut faces, &mut copied, input.positions.len());
    let mesh = compact(input, faces, &copied);

    check_count(&mesh, params)?;
    let s = subdivide::subdivide(mesh, params.max_edge());
    let parent = s.parent.iter().map(|&f| parent[f as usize]).collect();
    Ok(SynthesisMesh { mesh: s.mesh, parent, parent_bary: s.bary })
}

fn validate(p: &PrepareParams) -> Result<(), Error> {
    if !(p.scale > 0.0 && p.scale.is_finite()) {
        return Err(Error::Scale(p.scale));
    }
    if p.exemplar_size.contains(&0) {
        return Err(Error::ExemplarSize(p.exemplar_size));
    }
    if !(p.max_span_share > 0.0 && p.max_span_share <= 0.5) {
        return Err(Error::SpanShare(p.max_span_share));
    }
    Ok(())
}

/// Which vertices have a face; the lowest corner and the diagonal of their bounding box.
fn extent(mesh: &TriMesh) -> Result<(Vec<bool>, Vec3, f64), Error> {
    let vertices = mesh.positions.len();
    let mut used = vec![false; vertices];
    for (face, corners) in mesh.faces.iter().enumerate() {
        for &index in corners {
            *used.get_mut(index as usize).ok_or(Error::Index { face, index, vertices })? = true;
        }
    }
    let mut points = TriMesh::default();
    for vertex in (0..vertices).filter(|&v| used[v]) {
        let at = mesh.positions[vertex];
        // Not `>`: NaN fails as well.
        if !(at.x.abs() <= COORDINATE_LIMIT && at.y.abs() <= COORDINATE_LIMIT && at.z.abs() <= COORDINATE_LIMIT) {
            return Err(Error::Position { vertex, at });
        }
        points.positions.push(at);
    }
    let (low, high) = points.bounds();
    Ok((used, low, (high - low).length()))
}

/// True if the triangle stands higher than `tolerance` over its longest edge.
fn has_height([a, b, c]: [Vec3; 3], tolerance: f64) -> bool {
    let longest = (b - a).length().max((c - b).length()).max((a - c).length());
    (b - a).cross(c - a).length() > tolerance * longest
}

/// The mesh of these faces alone: used vertices in order, `copied` ones last.
fn compact(input: &TriMesh, mut faces: Vec<[u32; 3]>, copied: &[u32]) -> TriMesh {
    let mut index = vec![u32::MAX; input.positions.len() + copied.len()];
    faces.iter().flatten().for_each(|&v| index[v as usize] = 0);
    let mut positions = vec![];
    for (v, i) in index.iter_mut().enumerate().filter(|(_, i)| **i == 0) {
        *i = positions.len() as u32;
        let from = v.checked_sub(input.positions.len()).map_or(v, |c| copied[c] as usize);
        positions.push(input.positions[from]);
    }
    faces.iter_mut().flatten().for_each(|v| *v = index[*v as usize]);
    TriMesh { positions, faces }
}

/// Refuses a subdivision of too many faces, before it is made.
fn check_count(mesh: &TriMesh, params: &PrepareParams) -> Result<(), Error> {
    // Corners must be countable in 32 bits.
    let limit = params.face_limit.min(u32::MAX / 6);
    if mesh.faces.len() > limit as usize {
        return Err(Error::TooManyInputFaces { faces: mesh.faces.len(), limit });
    }
    let fits = |scale: f64| {
        let edge = PrepareParams { scale, ..*params }.max_edge();
        subdivide::count(mesh, edge, u64::from(limit)) <= u64::from(limit)
    };
    if fits(params.scale) {
        return Ok(());
    }
    let needed = subdivide::estimate(mesh, params.max_edge()).max(f64::from(limit) + 1.0);
    // From the scale that the estimate suggests down by fourth roots of two; with no edge halved the input fits.
    let mut scale = three_digits(params.scale * (f64::from(limit) / needed).sqrt());
    while scale > 0.0 && !fits(scale) {
        scale = three_digits(scale * 0.84);
    }
    Err(Error::TooManyFaces { needed, limit, scale: params.scale, fits: scale })
}

/// Rounded down to three significant digits.
fn three_digits(x: f64) -> f64 {
    let mut unit = 1.0;
    while x / unit >= 1000.0 {
        unit *= 10.0;
    }
    while x / unit < 100.0 && unit > 1e-300 {
        unit /= 10.0;
    }
    (x / unit).floor() * unit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::check::census;
    use crate::mesh::{Topology, zoo};
    use crate::numerics::vec::vec3;

    /// Edges of at most `max_edge`.
    fn params(max_edge: f64) -> PrepareParams {
        PrepareParams::new(16.0 / max_edge, [256, 512])
    }

    fn shattered(m: &TriMesh) -> TriMesh {
        let positions = (0..m.faces.len()).flat_map(|f| m.corners(f)).collect();
        TriMesh { positions, faces: (0..m.faces.len() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect() }
    }

    #[test]
    fn the_zoo_prepares_whole_or_shattered() {
        for (name, m) in zoo::all() {
            let a = prepare(&zoo::surface(m.clone()), &params(0.4)).unwrap_or_else(|e| panic!("{name}: {e}"));
            let b = prepare(&zoo::surface(shattered(&m)), &params(0.4)).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!((a.mesh.faces.len(), &a.parent_bary), (b.mesh.faces.len(), &b.parent_bary), "{name}");
            let (ca, cb) = (census(&a.mesh, &Topology::new(&a.mesh)), census(&b.mesh, &Topology::new(&b.mesh)));
            assert_eq!(ca, cb, "{name}: welded again");
            assert_eq!(ca.loose_vertices, 0, "{name}");
            for (f, &p) in a.parent.iter().enumerate() {
                let n = m.area_vector(p as usize);
                assert!(a.mesh.area_vector(f).dot(n) > 0.0, "{name}: face {f} turned over");
            }
        }
    }

    #[test]
    fn welding_takes_rounding_and_leaves_detail() {
        let mut m = shattered(&zoo::cube());
        m.positions.iter_mut().enumerate().for_each(|(i, p)| p.x += (i % 3) as f64 * 5e-8);
        let s = prepare(&zoo::surface(m.clone()), &params(9.0)).unwrap();
        assert_eq!((s.mesh.positions.len(), s.mesh.faces.len()), (8, 12));
        m.positions.iter_mut().enumerate().for_each(|(i, p)| p.x += (i % 3) as f64 * 5e-6);
        assert!(prepare(&zoo::surface(m), &params(9.0)).unwrap().mesh.positions.len() > 8);
    }

    #[test]
    fn what_has_no_area_goes_with_its_vertices() {
        let s = prepare(&zoo::surface(zoo::zero_area_face()), &params(9.0)).unwrap();
        assert_eq!((s.mesh.positions.len(), s.parent), (4, vec![0, 1]));
    }

    #[test]
    fn sides_of_a_sheet_are_parted() {
        let s = prepare(&zoo::surface(zoo::two_sided()), &params(0.3)).unwrap();
        let c = census(&s.mesh, &Topology::new(&s.mesh));
        assert_eq!((c.components, c.euler, c.non_manifold_edges), (2, 2, 0));
    }

    #[test]
    fn bad_input_gets_a_sentence() {
        let fail = |m: TriMesh, p: PrepareParams| prepare(&zoo::surface(m), &p).unwrap_err();
        let mut m = zoo::tetrahedron();
        m.positions[2].y = f64::NAN;
        assert!(matches!(fail(m.clone(), params(1.0)), Error::Position { vertex: 2, .. }));
        m.positions[2].y = 1e31;
        assert!(fail(m, params(1.0)).to_string().contains("at most 1e30"));
        let flat = zoo::mesh(&[[0.; 3], [1.; 3], [2.; 3]], &[[0, 1, 2], [0, 0, 1]]);
        assert_eq!(fail(flat, params(1.0)), Error::NoArea { faces: 2 });
        assert_eq!(fail(zoo::mesh(&[[5.; 3]], &[[0, 0, 0]]), params(1.0)), Error::NoArea { faces: 1 });
        assert_eq!(fail(TriMesh::default(), params(1.0)).to_string(), "the mesh has no triangles");
        let lost = TriMesh { positions: vec![vec3(0., 0., 0.)], faces: vec![[0, 1, 2]] };
        assert_eq!(
            prepare(&Surface { mesh: lost, ..zoo::surface(zoo::fan()) }, &params(1.0)).unwrap_err(),
            Error::Index { face: 0, index: 1, vertices: 1 }
        );
        for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(fail(zoo::fan(), PrepareParams::new(scale, [8, 8])), Error::Scale(_)));
        }
        assert!(matches!(fail(zoo::fan(), PrepareParams::new(1.0, [8, 0])), Error::ExemplarSize(_)));
        let share = |s| PrepareParams { max_span_share: s, ..params(1.0) };
        assert!([0.0, 0.6, f64::NAN].iter().all(|&s| matches!(fail(zoo::fan(), share(s)), Error::SpanShare(_))));
        let few = PrepareParams { face_limit: 11, ..params(1.0) };
        assert_eq!(fail(zoo::cube(), few), Error::TooManyInputFaces { faces: 12, limit: 11 });
    }

    #[test]
    fn too_fine_a_scale_is_refused_at_once_and_the_one_named_fits() {
        for scale in [1e4, 1e9, 1e200] {
            let p = PrepareParams { face_limit: 100_000, ..PrepareParams::new(scale, [64, 64]) };
            let error = prepare(&zoo::surface(zoo::cube()), &p).unwrap_err();
            let Error::TooManyFaces { needed, fits, .. } = error else { panic!("{error}") };
            assert!(needed > 1e5, "{error}");
            let s = prepare(&zoo::surface(zoo::cube()), &PrepareParams { scale: fits, ..p }).unwrap();
            assert!((5_000..=100_000).contains(&s.mesh.faces.len()), "{error}: {}", s.mesh.faces.len());
        }
        let p = PrepareParams::new(1e6, [64, 64]);
        println!("{}", prepare(&zoo::surface(zoo::torus(24, 12)), &p).unwrap_err());
    }

    #[test]
    fn real_meshes_prepare_in_moderate_time() {
        for name in ["beetle", "cow", "spot", "stanford-bunny", "cheburashka", "teapot"] {
            let Some(m) = zoo::obj(&format!("{name}.obj")) else { return };
            let (low, high) = m.bounds();
            let surface = zoo::surface(m);
            let start = std::time::Instant::now();
            let s = prepare(&surface, &params((high - low).length() / 200.0)).unwrap();
            let t = start.elapsed();
            let c = census(&s.mesh, &Topology::new(&s.mesh));
            println!("{name}: {} -> {} faces in {t:?}; {c:?}", surface.mesh.faces.len(), s.mesh.faces.len());
            let before = census(&surface.mesh, &Topology::new(&surface.mesh));
            assert_eq!(c.loose_vertices, 0);
            assert!(c.components <= before.components + 2, "{name}: {before:?}");
        }
    }
}
