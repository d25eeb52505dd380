//! Steps: periodic coordinates on the synthesis mesh, and where they lie in the tile (\[MST09\] sections 2 and 3).
//!
//! Coordinates are solved for once with the field of all constraints without a radius; each effect area of those with
//! one is then solved again for itself. So a changed constraint with a radius costs no more than its area, apart from
//! its field, and the rest keeps its coordinates.

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::field::{Laid, ScalarConstraint, components_without};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::mesh::{Topology, TriMesh};
use crate::numerics::csr::complex;
use crate::numerics::vec::Vec2;
use crate::param::{self, Around, Change, Fault, Locked, Parametrization, Phases, Singularity, singular_places};
use crate::texture::MapSet;

use super::field::FieldChange;
use super::prepare::Prepared;
use super::synthesise::{Counters, Synthesised};
use super::tile::MadeTile;

/// What corner coordinates look up: the maps of an exemplar, or a tile's.
pub(super) enum Source {
    Exemplar(MapSet),
    Tile(MadeTile),
}

impl Source {
    /// Input `index`, whichever it is.
    pub fn read(inputs: &Inputs, index: usize) -> Result<Self, StepError> {
        match MadeTile::is_one(&inputs[index]) {
            true => Ok(Source::Tile(super::read(inputs, index)?)),
            false => Ok(Source::Exemplar(super::read(inputs, index)?)),
        }
    }

    /// Maps from m = 0 to m = 1, one set for an exemplar; all with the same maps of the same size.
    pub fn layers(&self) -> &[MapSet] {
        match self {
            Source::Exemplar(maps) => std::slice::from_ref(maps),
            Source::Tile(made) => made.tile.layers(),
        }
    }

    /// The only maps, or those at m = 0.
    pub fn first(&self) -> &MapSet {
        &self.layers()[0]
    }

    pub fn is_tile(&self) -> bool {
        matches!(self, Source::Tile(_))
    }
}

impl Artefact for Parametrization {
    const TAG: [u8; 4] = *b"par2";

    fn write(&self, to: &mut Writer) {
        to.reserve(96 * self.phases.len() + 64 * self.corners.len());
        to.put(self.tile);
        to.slice(&self.phases.iter().map(plain).collect::<Vec<_>>());
        // Few faces are at fault.
        let faults: Vec<(u32, Fault)> = (0..).zip(self.faults.iter().copied()).filter(|(_, f)| !f.none()).collect();
        write_faults(&faults, to);
        to.slice(&self.corners);
        to.slice(&self.invalid.iter().map(|i| u8::from(*i)).collect::<Vec<_>>());
        write_steps(&self.steps, to);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let (tile, phases, faults) = read_angles(from)?;
        let corners: Vec<[Vec2; 3]> = from.slice()?;
        let invalid: Vec<u8> = from.slice()?;
        let steps = read_steps(from)?;
        if invalid.len() != phases.len() {
            return Err(Damaged("coordinates that do not fit each other".into()));
        }
        let faults = spread(&faults, corners.len())?;
        Ok(Parametrization {
            tile,
            phases,
            corners,
            faults,
            invalid: invalid.into_iter().map(|i| i != 0).collect(),
            steps,
        })
    }
}

impl Artefact for Change {
    const TAG: [u8; 4] = *b"chng";

    fn write(&self, to: &mut Writer) {
        to.pairs(self.phases.iter().map(|(v, phases)| (*v, plain(phases))));
        to.pairs(self.faces.iter().map(|f| (f.0, f.1)));
        write_faults(&self.faces.iter().map(|f| (f.0, f.2)).collect::<Vec<_>>(), to);
        to.slice(&self.invalid.iter().map(|&(v, invalid)| [v, u32::from(invalid)]).collect::<Vec<_>>());
        write_steps(&self.steps, to);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let phases = from.pairs()?.map(|(v, phases)| (v, angles(phases))).collect();
        let faces: Vec<(u32, [Vec2; 3])> = from.pairs()?.collect();
        let faults = read_faults(from)?;
        let invalid: Vec<[u32; 2]> = from.slice()?;
        let steps = read_steps(from)?;
        if faults.len() != faces.len() {
            return Err(Damaged("a change that does not fit itself".into()));
        }
        Ok(Change {
            phases,
            faces: faces.into_iter().zip(faults).map(|((f, corners), fault)| (f, corners, fault.1)).collect(),
            invalid: invalid.into_iter().map(|[v, invalid]| (v, invalid != 0)).collect(),
            steps,
        })
    }
}

fn plain([s, t]: &Phases) -> [f64; 4] {
    [s.re, s.im, t.re, t.im]
}

fn angles([a, b, c, d]: [f64; 4]) -> Phases {
    [complex(a, b), complex(c, d)]
}

fn write_faults(faults: &[(u32, Fault)], to: &mut Writer) {
    let plain = |&(face, Fault { distorted, around: Around { periods, quarters } }): &(u32, Fault)| {
        [face as i32, i32::from(distorted), periods[0], periods[1], i32::from(quarters)]
    };
    to.slice(&faults.iter().map(plain).collect::<Vec<_>>());
}

fn read_faults(from: &mut Reader<'_>) -> Result<Vec<(u32, Fault)>, Damaged> {
    let fault = |[face, distorted, s, t, quarters]: [i32; 5]| {
        let around = Around { periods: [s, t], quarters: quarters as u8 };
        (face as u32, Fault { distorted: distorted != 0, around })
    };
    Ok(from.slice()?.into_iter().map(fault).collect())
}

/// One for every face.
fn spread(faults: &[(u32, Fault)], faces: usize) -> Result<Vec<Fault>, Damaged> {
    let mut out = vec![Fault::default(); faces];
    for (face, fault) in faults {
        *out.get_mut(*face as usize).ok_or_else(|| Damaged(format!("face {face} of {faces}")))? = *fault;
    }
    Ok(out)
}

fn write_steps(steps: &[param::Step], to: &mut Writer) {
    to.pairs(steps.iter().map(|s| ([s.from, s.to], s.by)));
}

fn read_steps(from: &mut Reader<'_>) -> Result<Vec<param::Step>, Damaged> {
    Ok(from.pairs()?.map(|([from, to], by): ([u32; 2], Vec2)| param::Step { from, to, by }).collect())
}

/// Texels in a period, angles, and faces at fault.
type Angles = ([u32; 2], Vec<Phases>, Vec<(u32, Fault)>);

/// The beginning of coordinates.
fn read_angles(from: &mut Reader<'_>) -> Result<Angles, Damaged> {
    let (tile, phases): (_, Vec<[f64; 4]>) = (from.get()?, from.slice()?);
    Ok((tile, phases.into_iter().map(angles).collect(), read_faults(from)?))
}

/// Texels in a period, angles, and what is wrong with each face.
type Solved = ([u32; 2], Vec<Phases>, Vec<Fault>);

/// What an effect area needs of coordinates.
fn solved(bytes: &[u8]) -> Result<Solved, Damaged> {
    let mut from = Parametrization::open(bytes)?;
    let (tile, phases, faults) = read_angles(&mut from)?;
    let faces = from.pass::<[Vec2; 3]>()?;
    Ok((tile, phases, spread(&faults, faces)?))
}

/// The coordinates that are input `index`, changed by the next one if that is a change.
pub(super) fn coordinates(inputs: &Inputs, index: usize) -> Result<Parametrization, StepError> {
    let mut coordinates: Parametrization = super::read(inputs, index)?;
    if index + 1 < inputs.len() && Change::is_one(&inputs[index + 1]) {
        coordinates.apply(&super::read(inputs, index + 1)?)?;
    }
    Ok(coordinates)
}

/// Lays coordinates over the whole mesh: reads the synthesis mesh and the field of all constraints without a radius.
pub(super) struct Parametrise {
    pub recipe: String,
}

impl Step for Parametrise {
    super::step_identity!("parametrise", 4, travels);

    fn describe(&self, _: &mut dyn Visitor) {}

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let prepared = Prepared::ground(&inputs[0])?;
        let Laid { field, normals, symmetry, .. } = super::read(inputs, 1)?;
        let mesh = &prepared.mesh;
        let topo = Topology::new(mesh);
        Ok(param::parametrize(mesh, &topo, &normals, &field, symmetry, prepared.exemplar_size)?.to_bytes())
    }
}

/// Solves effect areas again: reads the synthesis mesh, the coordinates, the field that they follow, and how areas change
/// that. Gives what changes, so that it costs by the areas.
pub(super) struct FollowAreas {
    pub recipe: String,
}

impl Step for FollowAreas {
    super::step_identity!("effect areas", 4);

    fn describe(&self, _: &mut dyn Visitor) {}

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let ground = Prepared::ground(&inputs[0])?;
        let (tile, phases, faults) = solved(&inputs[1]).map_err(|e| format!("{}: {e}", inputs.label(1)))?;
        let before: Laid = super::read(inputs, 2)?;
        let mut after = before.field.clone();
        super::read::<FieldChange>(inputs, 3)?.apply(&mut after)?;
        let locked = Locked { tile, phases: &phases, faults: &faults };
        let fields = [&before.field, &after];
        Ok(param::follow(&locked, &ground.mesh, &before.normals, fields, before.symmetry)?.to_bytes())
    }
}

/// Places the mesh in the tile: reads the synthesis mesh and its coordinates, and perhaps their change.
pub(super) struct PlaceInTile {
    pub recipe: String,
    /// m at points.
    pub material: Vec<ScalarConstraint>,
    /// With no word on m and one key only: m wanders over the surface, by this seed, so that no period shows.
    pub wandering: Option<u64>,
}

impl Step for PlaceInTile {
    super::step_identity!("place in tile", 3);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("material", &self.material);
        v.param("wandering", &self.wandering);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let prepared = Prepared::ground(&inputs[0])?;
        let coordinates = coordinates(inputs, 1)?;
        let mesh = &prepared.mesh;
        let topo = Topology::new(mesh);
        let material = match self.wandering {
            Some(seed) => {
                let side = prepared.exemplar_size[0].min(prepared.exemplar_size[1]);
                param::wandering(mesh, f64::from(side) / prepared.scale, seed)
            }
            None => param::material(mesh, &topo, &self.material)?,
        };
        let unsaid = match self.material.is_empty() {
            true => 0,
            false => components_without(mesh, &topo, "material", &self.material)? as u64,
        };
        let sets = coordinates.sets(mesh, &material)?;
        let count = |of: &dyn Fn(usize) -> bool| (0..mesh.faces.len()).filter(|f| of(*f)).count() as u64;
        let counters = Counters::Periodic {
            distorted: count(&|f| coordinates.faults[f].distorted),
            winding: count(&|f| !coordinates.faults[f].around.closes()),
            three_look_ups: count(&|f| coordinates.look_ups(mesh, f) == 3),
            unsaid,
        };
        Ok(Synthesised { sets, counters, metric: vec![] }.to_bytes())
    }
}

/// Where coordinates are not valid on a mesh with a field.
pub(super) fn places(mesh: &TriMesh, laid: &Laid, coordinates: &Parametrization) -> Vec<Singularity> {
    let faces: Vec<u32> = laid.turning.iter().map(|f| f.0).collect();
    singular_places(mesh, &Topology::new(mesh), &coordinates.faults, &faces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{Field, Symmetry};
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;

    #[test]
    fn coordinates_survive_the_round_trip_and_damage_is_told() {
        let mesh = zoo::icosphere(1);
        let (topo, normals) = (Topology::new(&mesh), mesh.vertex_normals());
        let up = normals.iter().map(|n| vec3(0.1, 1.0, 0.2).reject(*n).normalized().expect("not up")).collect();
        let field = Field { up, scale: vec![9.0; normals.len()] };
        let laid =
            param::parametrize(&mesh, &topo, &normals, &field, Symmetry::One, [8, 8]).expect("a mesh and a field");
        let bytes = laid.to_bytes();
        assert_eq!(Parametrization::from_bytes(&bytes).as_ref(), Ok(&laid));
        assert!((0..bytes.len()).step_by(7).all(|cut| Parametrization::from_bytes(&bytes[..cut]).is_err()));
        let (tile, phases, faults) = solved(&bytes).expect("its beginning");
        assert_eq!((tile, &phases, &faults), (laid.tile, &laid.phases, &laid.faults));
        let mut after = field.clone();
        after.up[3] = after.up[3].cross(normals[3]);
        let locked = Locked { tile, phases: &phases, faults: &faults };
        let change = param::follow(&locked, &mesh, &normals, [&field, &after], Symmetry::One).expect("a change");
        let bytes = change.to_bytes();
        assert!((0..bytes.len()).step_by(7).all(|cut| Change::from_bytes(&bytes[..cut]).is_err()));
        assert_eq!(Change::from_bytes(&bytes).as_ref(), Ok(&change));
        let mut small = laid.clone();
        small.phases.truncate(2);
        assert!(small.apply(&change).is_err() && laid.clone().apply(&change).is_ok());
    }
}
