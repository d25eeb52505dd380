//! Real meshes and materials of the development data through the whole program: what comes out is measured.
//!
//! `KILN_SLOW=1` (tests/slow/real_data.sh) bakes the large ones as well.

mod common;

use common::{Project, shared};

struct Case {
    mesh: &'static str,
    map: &'static str,
    /// Texels per unit, as TOML.
    scale: &'static str,
    slow: bool,
}

const fn case(mesh: &'static str, map: &'static str, scale: &'static str, slow: bool) -> Case {
    Case { mesh, map, scale, slow }
}

const CASES: &[Case] = &[
    case("meshes/glb/spot.glb", "textures/leopard_128.png", "150.0", false),
    case("meshes/glb/suzanne.glb", "textures/soil_256.png", "150.0", false),
    case("meshes/glb/beetle.glb", "textures/wicker_192.png", "300.0", true),
    case("meshes/glb/fertility.glb", "textures/pebbles_192.png", "3.0", true),
    case("meshes/glb/fandisk.glb", "materials/bricks/albedo_256.png", "60.0", true),
    case("meshes/glb/stanford-bunny.glb", "textures/pebbles_192.png", "3000.0", true),
    case("meshes/gltf/CesiumMilkTruck/CesiumMilkTruck.glb", "materials/rusty-metal/albedo_256.png", "100.0", false),
    case("meshes/gltf/SimpleSkin/SimpleSkin.gltf", "textures/leopard_128.png", "\"auto\"", false),
    case("meshes/gltf/Fox/Fox.glb", "textures/leopard_128.png", "2.0", true),
    case("meshes/gltf/AnimatedMorphCube/AnimatedMorphCube.gltf", "textures/wicker_192.png", "\"auto\"", false),
    case("meshes/gltf/BobMirrored/bob_mirrored.glb", "textures/wicker_192.png", "200.0", false),
    case("meshes/gltf/DamagedHelmet/DamagedHelmet.glb", "materials/bark/albedo_256.png", "200.0", true),
    case("meshes/gltf/CheburashkaMeshopt/cheburashka_meshopt.glb", "textures/soil_256.png", "300.0", true),
    case("meshes/gltf/SpotQuantized/spot_quantized.glb", "textures/leopard_128.png", "150.0", false),
];

/// Means of the colour difference across seams at mip 0 and at mips 1 to 3 that a bake must keep to, in 8-bit steps.
const SEAM: [f64; 4] = [1.5, 3.0, 3.0, 3.0];

#[test]
fn real_meshes_bake_with_seams_that_do_not_show() {
    let slow = std::env::var_os("KILN_SLOW").is_some();
    for case in CASES.iter().filter(|c| slow || !c.slow) {
        let (Some(mesh), Some(map)) = (shared(case.mesh), shared(case.map)) else { continue };
        let project = Project::new();
        let size = if slow { 1024 } else { 512 };
        project.write(
            "recipes/case.toml",
            format!(
                "[mesh]\npath = {mesh:?}\n[exemplar]\nbase_color = {map:?}\n[synthesis]\nscale = {}\n\
                 [atlas]\nsize = {size}\n[uv_sets]\n",
                case.scale
            ),
        );
        project.kiln(&["bake", "-q"]).expect(0);
        let report: serde_json::Value = serde_json::from_slice(&project.read("out/case/report.json")).expect("JSON");
        for (mip, most) in SEAM.iter().enumerate() {
            let seam = report["atlas"]["quality"][format!("seam_mip{mip}")].as_f64().expect("a figure");
            println!("{} mip {mip}: {seam:.2}", case.mesh);
            assert!(seam <= *most, "{}: seams differ by {seam} at mip {mip}, allowed {most}", case.mesh);
        }
        let walk = &report["synthesis"]["walk"];
        let count = |key: &str| walk[key].as_u64().expect("a count");
        let steps = count("jumps") + count("continuations") + count("random_fallbacks");
        assert!(count("random_fallbacks") * 20 <= steps, "{}: fallbacks are meant to be rare: {walk}", case.mesh);
        // Both files are read again as scenes.
        for file in ["out/case/case.glb", "out/case/case.uvsets.glb"] {
            project.kiln(&["inspect", file]).expect(0);
        }
    }
}
