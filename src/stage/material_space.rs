//! Steps: periodic coordinates on the synthesis mesh, and where they lie in the tile (\[MST09\] sections 2 and 3).
//!
//! Coordinates are solved for once with the field of all constraints without a radius; each effect area of those with
//! one is then solved again for itself. So a changed constraint with a radius costs no more than its area, apart from
//! its field, and the rest keeps its coordinates.

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::field::{Laid, ScalarConstraint, components_without};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::mesh::Topology;
use crate::numerics::csr::complex;
use crate::numerics::vec::Vec2;
use crate::param::{self, Around, Fault, Parametrization, Singularity, singular_places};
use crate::texture::MapSet;

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
    const TAG: [u8; 4] = *b"para";

    fn write(&self, to: &mut Writer) {
        to.put(self.tile);
        to.slice(&self.phases.iter().map(|[s, t]| [s.re, s.im, t.re, t.im]).collect::<Vec<_>>());
        to.slice(&self.at);
        to.slice(&self.steps);
        to.slice(&self.corners);
        let fault = |f: &Fault| {
            let Around { periods, quarters } = f.around;
            [i32::from(f.distorted), periods[0], periods[1], i32::from(quarters)]
        };
        to.slice(&self.faults.iter().map(fault).collect::<Vec<_>>());
        to.slice(&self.invalid.iter().map(|i| u8::from(*i)).collect::<Vec<_>>());
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let tile = from.get()?;
        let phases: Vec<[f64; 4]> = from.slice()?;
        let at: Vec<Vec2> = from.slice()?;
        let steps: Vec<Vec2> = from.slice()?;
        let corners: Vec<[Vec2; 3]> = from.slice()?;
        let faults: Vec<[i32; 4]> = from.slice()?;
        let invalid: Vec<u8> = from.slice()?;
        if (at.len(), invalid.len(), faults.len()) != (phases.len(), phases.len(), corners.len()) {
            return Err(Damaged("coordinates that do not fit each other".into()));
        }
        let fault = |[distorted, s, t, quarters]: [i32; 4]| Fault {
            distorted: distorted != 0,
            around: Around { periods: [s, t], quarters: quarters as u8 },
        };
        Ok(Parametrization {
            tile,
            phases: phases.into_iter().map(|[a, b, c, d]| [complex(a, b), complex(c, d)]).collect(),
            at,
            steps,
            corners,
            faults: faults.into_iter().map(fault).collect(),
            invalid: invalid.into_iter().map(|i| i != 0).collect(),
        })
    }
}

/// Lays coordinates over the whole mesh: reads the synthesis mesh and the field of all constraints without a radius.
pub(super) struct Parametrise {
    pub recipe: String,
}

impl Step for Parametrise {
    super::step_identity!("parametrise", 3, travels);

    fn describe(&self, _: &mut dyn Visitor) {}

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let prepared: Prepared = super::read(inputs, 0)?;
        let Laid { field, normals, symmetry, .. } = super::read(inputs, 1)?;
        let mesh = &prepared.mesh.mesh;
        let topo = Topology::new(mesh);
        Ok(param::parametrize(mesh, &topo, &normals, &field, symmetry, prepared.exemplar_size)?.to_bytes())
    }
}

/// Solves effect areas again: reads the synthesis mesh, the coordinates, the field that they follow and that of all
/// constraints.
pub(super) struct FollowAreas {
    pub recipe: String,
}

impl Step for FollowAreas {
    super::step_identity!("effect areas", 3);

    fn describe(&self, _: &mut dyn Visitor) {}

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let prepared: Prepared = super::read(inputs, 0)?;
        let mut coordinates: Parametrization = super::read(inputs, 1)?;
        let [before, after] = [super::read::<Laid>(inputs, 2)?, super::read::<Laid>(inputs, 3)?];
        let mesh = &prepared.mesh.mesh;
        let topo = Topology::new(mesh);
        coordinates.follow(mesh, &topo, &after.normals, [&before.field, &after.field], after.symmetry)?;
        Ok(coordinates.to_bytes())
    }
}

/// Places the mesh in the tile: reads the synthesis mesh and its coordinates.
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
        let prepared: Prepared = super::read(inputs, 0)?;
        let coordinates: Parametrization = super::read(inputs, 1)?;
        let mesh = &prepared.mesh.mesh;
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
        let sets = coordinates.sets(mesh, &topo, &material)?;
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
pub(super) fn places(prepared: &Prepared, laid: &Laid, coordinates: &Parametrization) -> Vec<Singularity> {
    let mesh = &prepared.mesh.mesh;
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
        assert_eq!(Parametrization::from_bytes(&bytes), Ok(laid));
        assert!((0..bytes.len()).step_by(7).all(|cut| Parametrization::from_bytes(&bytes[..cut]).is_err()));
    }
}
