#!/usr/bin/env python3
"""Makes the pictures of textons in the gallery anew, from the meshes and samples of the recipes.

    tests/quality/gallery.py [--kiln FILE] [--out DIR]

`textons.png`: a sample, its texton map ([MK03] figure 2), and what grows of it. `texton-edges.png`: a close-up without and
with blending (figure 5), the pieces of the sample, the blend metric of the edges (3.3.2), a singular point (figure 7).
`texton-meshes.png`: samples over meshes (figures 1 and 8). All but the texton map are `[[render]]` views. Needs pillow.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ASSETS = ROOT / "recipes/assets"
# Sides of pictures.
LARGE, MIDDLE, SMALL = 164, 140, 124
CLOSE = "camera = { eye = [0.0, 0.25, 1.9], target = [0.0, 0.25, 0.0], fov_deg = 11 }"
SOURCE = "[field]\nsingularities = [ { at = [0, 0, 1], kind = \"source\" }, { at = [0, 0, -1], kind = \"sink\" } ]"
# Mesh, sample and scale of figure 8.
MESHES = [
    ("knot.glb", "pebbles", 110), ("ring.gltf", "scales", 170), ("vase.obj", "twill", 220), ("carved-sphere.glb", "bark", 160),
    ("vase.obj", "bark", 150), ("knot.glb", "bricks", 150), ("ring.gltf", "pebbles", 140), ("carved-sphere.glb", "rusted-plate", 150),
]


def recipe(mesh, sample, scale, refine, views, more=""):
    """A recipe with `views`, each the lines of a `[[render]]`."""
    maps = [f'{m} = "{p}"' for m in ("base_color", "normal", "roughness", "height") if (p := ASSETS / sample / f"{m}.png").exists()]
    method = '[analysis]\nmethod = "texton"'
    blend = more if more.startswith("blend") else ""
    field = "" if blend else more
    return "\n".join([
        "kiln = 1", f'mesh.path = "{ASSETS / "meshes" / mesh}"', "[exemplar]", *maps, method, field,
        "[synthesis]", f"scale = {scale}.0", f"refine = {refine}", blend, "[uv_sets]",
        *(f"[[render]]\n{v}" for v in views), "",
    ])


def strip(pictures, columns, side, path):
    """Pictures side by side, in 256 colours."""
    from PIL import Image

    rows = -(-len(pictures) // columns)
    out = Image.new("RGB", (columns * side, rows * side))
    for i, picture in enumerate(pictures):
        out.paste(Image.open(picture).convert("RGB").resize((side, side), Image.LANCZOS), (i % columns * side, i // columns * side))
    out.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size} bytes")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kiln", default=ROOT / "target/release/kiln", help="the program to draw with")
    parser.add_argument("--out", default=ASSETS / "gallery", help="where the pictures go")
    args = parser.parse_args()
    kiln, to = Path(args.kiln).resolve(), Path(args.out)
    whole = f'view = "turntable-1"\nsize = {2 * LARGE}'
    close = lambda shading: f'{CLOSE}\nsize = {2 * LARGE}\nshading = "{shading}"'
    singular = f"camera = {{ eye = [0.6, 0.5, 3.2], target = [0.0, 0.0, 0.0], fov_deg = 27 }}\nsize = {2 * LARGE}"
    jobs = {
        "vase": recipe("vase.obj", "bricks", 150, 2, [whole]),
        "ring": recipe("ring.gltf", "scales", 170, 2, [whole]),
        "apart": recipe("vase.obj", "bricks", 150, 0, [close("unlit")], 'blend = "none"'),
        "blended": recipe("vase.obj", "bricks", 150, 0, [close("unlit"), close("patches"), close("edges")]),
        "singular": recipe("carved-sphere.glb", "bricks", 150, 2, [singular], SOURCE),
    }
    jobs |= {f"mesh-{i}": recipe(*m, 2, [whole]) for i, m in enumerate(MESHES)}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "recipes").mkdir()
        (folder / "kiln.toml").write_text("")
        for name, text in jobs.items():
            (folder / f"recipes/{name}.toml").write_text(text)
        subprocess.run([kiln, "-C", folder, "bake", "-q"], check=True)
        sample, textons = ASSETS / "bricks/base_color.png", folder / "textons.png"
        subprocess.run([kiln, "inspect", sample, "--texton-map", textons], check=True, stdout=subprocess.DEVNULL)
        view = lambda name, which="turntable-1": folder / f"out/{name}/render/{which}.png"
        strip([sample, textons, view("vase"), view("ring")], 4, LARGE, to / "textons.png")
        views = [view("apart", "camera"), *(view("blended", c) for c in ("camera", "camera-patches", "camera-edges")), view("singular", "camera")]
        strip(views, 5, MIDDLE, to / "texton-edges.png")
        strip([view(f"mesh-{i}") for i in range(len(MESHES))], 4, SMALL, to / "texton-meshes.png")


if __name__ == "__main__":
    main()
