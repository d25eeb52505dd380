//! Which primitives a UV-set bake writes, and their materials.
//!
//! In: parts, the synthesis mesh and its sets. Out: faces, a primitive and a material for each piece.
//! Reads as: in material space nearly all triangles are shown by one look-up (\[MST09\] section 3). They become a primitive
//! with one set, and those that blend one of their own: half the bytes per vertex nearly everywhere, and a third of the
//! look-ups, for a second draw call.
//! Unaware of: vertices.

use super::edit::Editor;
use super::refs::{Kind, list};
use super::uvsets::UvSetOutput;
use super::{material, primitive};
use crate::mesh::{Part, Surface, SynthesisMesh};
use crate::uvset::UvSets;

/// Triangles that become one primitive.
pub(super) struct Piece<'a> {
    /// The part that they come from.
    pub(super) part: &'a Part,
    /// The primitive that they become.
    pub(super) primitive: u32,
    /// Faces of the synthesis mesh, in order.
    pub(super) faces: Vec<u32>,
    /// Sets that they need.
    pub(super) count: usize,
    /// It is a primitive of its own behind all of the mesh.
    is_behind: bool,
}

impl Piece<'_> {
    /// Takes from its primitive what will be written anew, or adds a primitive like it.
    pub(super) fn claim(&mut self, editor: &mut Editor) {
        let own = editor.primitive(self.part.mesh, self.primitive);
        primitive::strip(own, false, false);
        if self.is_behind {
            let copy = own.clone();
            if let Some(all) = editor.root["meshes"][self.part.mesh as usize]["primitives"].as_array_mut() {
                self.primitive = all.len() as u32;
                all.push(copy);
            }
        }
    }
}

/// What each part becomes: in material space a piece with one look-up and one with several, else one of all sets.
pub(super) fn pieces<'a>(
    surface: &'a Surface,
    synthesis: &SynthesisMesh,
    sets: &UvSets,
    output: &UvSetOutput,
) -> Vec<Piece<'a>> {
    let splits = output.material_space.is_some() && sets.sets.len() > 1;
    let is_single = |f: usize| sets.weights[3 * f..3 * f + 3].iter().all(|w| *w == [1.0, 0.0, 0.0, 0.0]);
    // Of each part those that blend, or all, then those that do not.
    let mut faces = vec![[Vec::new(), Vec::new()]; surface.parts.len()];
    for (f, &parent) in synthesis.parent.iter().enumerate() {
        let part = surface.parts.partition_point(|p| p.faces.end <= parent);
        faces[part][usize::from(splits && is_single(f))].push(f as u32);
    }
    let mut out = Vec::new();
    for (part, [blended, single]) in surface.parts.iter().zip(faces) {
        let is_behind = !single.is_empty();
        let piece = |faces, count, is_behind| Piece { part, primitive: part.primitive, faces, count, is_behind };
        let both = [piece(single, 1, false), piece(blended, sets.sets.len(), is_behind)];
        out.extend(both.into_iter().filter(|p| !p.faces.is_empty()));
    }
    out
}

/// Sets of coordinates that stand before the input's, for primitives with so many sets.
pub(super) fn shift(count: usize, output: &UvSetOutput) -> usize {
    count + if output.repeat_weights_in_uv { 1 + usize::from(count > 3) } else { 0 }
}

/// Gives every piece a material for its number of sets, and these with that number. The input's material is that of the
/// primitives with the fewest.
pub(super) fn prepare_materials(editor: &mut Editor, pieces: &[Piece], output: &UvSetOutput) -> Vec<(usize, usize)> {
    let mut counts: Vec<usize> = pieces.iter().map(|p| p.count).collect();
    counts.sort_unstable();
    counts.dedup();
    let mut out = Vec::new();
    for &count in counts.iter().rev() {
        let written = |p: &Piece| Part { primitive: p.primitive, ..p.part.clone() };
        let parts: Vec<Part> = pieces.iter().filter(|p| p.count == count).map(written).collect();
        let known = list(&editor.root, "materials").len();
        for m in material::prepare(editor, &parts, &output.maps.material_name, shift(count, output)) {
            let material = editor.entry(Kind::Material, m);
            if let (true, Some(name)) = (m >= known && count > counts[0], material["name"].as_str()) {
                material["name"] = format!("{name} ({count} sets)").into();
            }
            out.push((m, count));
        }
    }
    out
}
