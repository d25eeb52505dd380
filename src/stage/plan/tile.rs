//! The tile of material space becomes steps, and how a surface is placed in it.

use crate::build::{InputId, StepId};
use crate::field::ScalarConstraint;
use crate::io::ktx2::Shape;
use crate::recipe::{self, ExemplarMap, Sample, Word};
use crate::texture::MapKind;
use crate::tile::TileParams;

use super::super::material_space::{FollowAreas, Parametrise, PlaceInTile};
use super::super::tile::{MakeTile, TileStrip, TileTexture};
use super::Planner;

impl Planner<'_, '_> {
    /// The tile of material space, and its files.
    pub(super) fn tile(&mut self, from: &recipe::TileKeys) -> StepId {
        let recipe::TileKeys { layers, keys, shape } = from;
        let keys: Vec<Sample> = self.recipe.exemplar.samples().into_iter().chain(keys.iter().cloned()).collect();
        let maps: Vec<InputId> = keys.iter().enumerate().map(|(i, key)| self.maps(i, key).into()).collect();
        let importance = self.recipe.exemplar.importance.iter().copied().collect();
        let seed = self.recipe.synthesis.seed;
        let params = TileParams { layers: *layers, seed, importance, ..TileParams::default() };
        let (recipe, tileable) = (self.name(), self.recipe.exemplar.tileable);
        let tile = self.step(MakeTile { recipe: recipe.clone(), params, tileable }, &maps);
        let shape = match shape {
            recipe::TileShape::Volume => Shape::Volume,
            recipe::TileShape::Array => Shape::Array,
        };
        for (i, ExemplarMap { map, .. }) in keys[0].maps.iter().enumerate() {
            // The first map, the colour where there is one, is the tile; the others are told by their names.
            let file =
                if i == 0 { format!("{recipe}.tile.ktx2") } else { format!("{recipe}.tile.{}.ktx2", map.name()) };
            let texture = self.step(TileTexture { recipe: recipe.clone(), map: *map, shape }, &[tile.into()]);
            self.output(texture, &file);
        }
        for map in keys[0].maps.iter().map(|m| Some(m.map)).chain([None]) {
            let strip = self.step(TileStrip { recipe: recipe.clone(), map }, &[tile.into()]);
            let name = map.map_or(MapKind::FeatureMask.name(), |m| m.name());
            self.output(strip, &format!("{recipe}.tile.{name}.png"));
        }
        tile
    }

    /// Lays periodic coordinates over the prepared mesh and its field (that without what acts nearby, and its change), and places
    /// it in the tile. Gives where it lies, and the coordinates and perhaps their change.
    pub(super) fn place_in_tile(
        &mut self,
        keys: &recipe::TileKeys,
        from: &recipe::Field,
        prepare: StepId,
        field: &[StepId],
    ) -> (StepId, Vec<StepId>) {
        let recipe = self.name();
        let mut laid = vec![self.step(Parametrise { recipe: recipe.clone() }, &[prepare, field[0]].map(InputId::from))];
        if let [first, areas] = *field {
            let inputs = [prepare, laid[0], first, areas].map(InputId::from);
            laid.push(self.step(FollowAreas { recipe: recipe.clone() }, &inputs));
        }
        let value = |&recipe::MaterialPoint { at, value, radius }: &_| ScalarConstraint { at, value, radius };
        let material: Vec<ScalarConstraint> = from.material.iter().map(value).collect();
        let wandering = (keys.keys.is_empty() && material.is_empty()).then_some(self.recipe.synthesis.seed);
        let inputs: Vec<InputId> = [prepare].iter().chain(&laid).map(|s| InputId::from(*s)).collect();
        let placed = self.step(PlaceInTile { recipe, material, wandering }, &inputs);
        (placed, laid)
    }
}

/// The field without what acts only nearby.
pub(super) fn without_areas(field: &recipe::Field) -> recipe::Field {
    let mut field = field.clone();
    field.orientation.retain(|c| c.radius.is_none());
    field.singularities.retain(|c| c.radius.is_none());
    field.scale.retain(|c| c.radius.is_none());
    field
}
