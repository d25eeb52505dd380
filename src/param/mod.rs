//! Periodic coordinates (s, t) and the material m on a surface: where every point lies in the tile.
//!
//! Source: `[MST09]` sections 2 and 3. In: a mesh and a field. Out: a [`Parametrization`], and from it the corner
//! coordinates that every output starts from ([`Parametrization::sets`]).
//!
//! ```text
//! field --guide, curl--> wanted change along edges --periodic, settle--> angles at vertices --recover--> corners of faces
//!                                                                                                            |
//!                                                                   1-rings that are not valid <--singular---'
//! ```
//!
//! `effect` does the same within an area, all else locked. Unaware of: what is in the tile, files.

mod curl;
mod effect;
mod error;
mod guide;
mod material;
mod periodic;
mod recover;
mod settle;
mod singular;
#[cfg(test)]
mod tests;

pub use effect::{Change, Locked, follow};
pub use error::Error;
pub use material::{material, wandering};
pub use periodic::Phases;
pub use recover::Around;
pub use singular::{Fault, Kind, Singularity, singular_places};

use crate::field::{Field, Symmetry};
use crate::mesh::{Topology, TriMesh};
use crate::numerics::csr::Complex;
use crate::numerics::par;
use crate::numerics::vec::{Vec2, Vec3};
use guide::{Guide, Wanted};

/// Periodic coordinates of a mesh, in periods of the tile.
#[derive(Clone, Debug, PartialEq)]
pub struct Parametrization {
    /// Texels in a period of s and of t.
    pub tile: [u32; 2],
    /// s and t of each vertex as angles: numbers of absolute value 1; 1 where no face is.
    pub phases: Vec<Phases>,
    /// Coordinates of each face's corners, in the frame of the first.
    pub corners: Vec<[Vec2; 3]>,
    /// What is wrong with each face.
    pub faults: Vec<Fault>,
    /// Vertices whose 1-ring holds a face at fault.
    pub invalid: Vec<bool>,
    /// Along all edges of these, ascending.
    pub steps: Vec<Step>,
}

/// The wanted change along an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// From this vertex, in whose frame it is.
    pub from: u32,
    /// To that one.
    pub to: u32,
    /// In periods.
    pub by: Vec2,
}

/// Lays periodic coordinates over a mesh: s grows to the right of the field and t against it, both by one period for
/// every `tile` texels, as near as can be.
///
/// `normals` are the unit normals of the vertices. Vertices without a face stay as they are. Panics if `topo` is not the
/// mesh's.
pub fn parametrize(
    mesh: &TriMesh,
    topo: &Topology,
    normals: &[Vec3],
    field: &Field,
    symmetry: Symmetry,
    tile: [u32; 2],
) -> Result<Parametrization, Error> {
    let wanted = Wanted { mesh, topo, normals, field, symmetry, tile };
    check(&wanted)?;
    let guide = wanted.guide();
    let mut z = vec![[Complex::ONE; 2]; topo.vertex_count()];
    // One vertex of each component is locked, the lowest.
    let (labels, count) = crate::mesh::check::components(topo);
    let mut locked = vec![false; count];
    let open =
        |&v: &u32| !topo.half_edges(v).is_empty() && std::mem::replace(&mut locked[labels[v as usize] as usize], true);
    let open: Vec<u32> = (0..topo.vertex_count() as u32).filter(open).collect();
    solve(&wanted, &guide, &|_| true, &open, &mut z);
    Ok(finish(&wanted, guide, z))
}

/// Angles at the vertices `free`, all others locked: a start from steps with less curl where `may_change` says so of a
/// vertex, settled for the field's own.
fn solve(wanted: &Wanted<'_>, guide: &Guide, may_change: &dyn Fn(u32) -> bool, free: &[u32], z: &mut [Phases]) {
    let mut even = guide.clone();
    curl::lessen(wanted, &mut even, may_change);
    periodic::solve(&even, wanted.topo, free, wanted.symmetry, true, z);
    settle::settle(wanted, guide, free, z);
}

/// Coordinates at corners from angles at vertices.
fn finish(wanted: &Wanted<'_>, guide: guide::Guide, phases: Vec<Phases>) -> Parametrization {
    let (mesh, topo) = (wanted.mesh, wanted.topo);
    let at = par::map(phases.len(), |v| recover::periods(&phases[v]));
    let changes = recover::changes(&guide, topo, &at);
    let faces = par::map(mesh.faces.len(), |f| {
        let (corners, around) = recover::corners(&guide, topo, &at, &changes, mesh.faces[f]);
        (corners, Fault { distorted: singular::distorted(wanted, f, &corners), around })
    });
    let (corners, faults): (Vec<_>, Vec<_>) = faces.into_iter().unzip();
    let mut invalid = vec![false; phases.len()];
    for (face, _) in mesh.faces.iter().zip(&faults).filter(|(_, fault)| !fault.none()) {
        face.iter().for_each(|&v| invalid[v as usize] = true);
    }
    let centres = (0..phases.len() as u32).filter(|&v| invalid[v as usize]);
    let steps = centres.flat_map(|v| steps_around(topo, v, &guide.steps)).collect();
    Parametrization { tile: wanted.tile, phases, corners, faults, invalid, steps }
}

/// The steps along the edges of a vertex.
fn steps_around<'a>(topo: &'a Topology, v: u32, steps: &'a [Vec2]) -> impl Iterator<Item = Step> {
    topo.half_edges(v).map(move |h| Step { from: v, to: topo.target(h), by: steps[h] })
}

fn check(wanted: &Wanted<'_>) -> Result<(), Error> {
    let expected = wanted.mesh.positions.len();
    let same = |what, found| if found == expected { Ok(()) } else { Err(Error::Mismatch { what, found, expected }) };
    same("vertices in the topology", wanted.topo.vertex_count())?;
    same("normals", wanted.normals.len())?;
    same("directions", wanted.field.up.len())?;
    same("scales", wanted.field.scale.len())?;
    if wanted.tile.contains(&0) {
        return Err(Error::Tile(wanted.tile));
    }
    if wanted.symmetry == Symmetry::Four && wanted.tile[0] != wanted.tile[1] {
        return Err(Error::NotSquare(wanted.tile));
    }
    let scales = &wanted.field.scale;
    if let Some(vertex) = scales.iter().position(|s| !(s.is_normal() && *s > 0.0)) {
        return Err(Error::Scale { vertex, scale: scales[vertex] });
    }
    let unit = |u: &Vec3| (u.length() - 1.0).abs() < 1e-3;
    match wanted.field.up.iter().position(|u| !unit(u)) {
        Some(vertex) => Err(Error::Direction { vertex }),
        None => Ok(()),
    }
}
