//! Makes the sample materials and meshes in `recipes/assets`, all ours: `cargo run --release --example make_samples`.
//!
//! Run once and committed, so that nothing has to be fetched; run again, it writes the same bytes.

mod bark;
mod ember;
mod glb;
mod guides;

mod masonry;
mod material;
mod meshes;

mod noise;
mod pebbles;
mod rust;
mod smoke;
mod weave;

use std::path::Path;

fn main() -> std::io::Result<()> {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("recipes/assets");
    pebbles::pebbles().write(&assets.join("pebbles"))?;
    bark::bark().write(&assets.join("bark"))?;
    weave::twill().write(&assets.join("twill"))?;
    weave::burlap().write(&assets.join("burlap"))?;
    rust::rusted_plate().write(&assets.join("rusted-plate"))?;
    masonry::bricks().write(&assets.join("bricks"))?;
    masonry::scales().write(&assets.join("scales"))?;
    ember::ember().write(&assets.join("ember"))?;
    guides::write_all(&assets.join("guides"))?;
    smoke::write(&assets.join("smoke"))?;
    meshes::write_all(&assets.join("meshes"))
}
