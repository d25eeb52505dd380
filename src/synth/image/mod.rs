//! Flat images (\[ZG02\] section 3), part by part or whole: an [`order`], the [`walk`], the correction ([`refine`]), a [`copy`]; put
//! together by [`canvas`]. With several samples ([`mixture`]), guides ([`guide`]) and holes.
//! Unaware of: how the jump map was made, recipes, files.

mod board;
pub mod canvas;
pub mod copy;
pub mod guide;
pub mod guide_light;
pub(super) mod hole_shifts;
pub mod mixture;
pub mod order;
pub mod refine;
pub mod source_map;
pub mod source_strips;
pub mod walk;
mod window;
