#!/usr/bin/env python3
"""Table of the quality of synthesis on surfaces: methods against each other, flat synthesis and two flat peers.

    tests/quality/surface.py [--kiln FILE] [--keep DIR] [--only basket,granite] [--ways jump-map:0,jump-map,texton]
                             [--meshes plane48,plane160,spot]

Bakes irregular planes of so many cells and whole meshes, all exemplars and ways in one project, and measures them with
the tools beside the project: the unrolled plane (256 x 256 texels) as a flat texture, a mesh by patches cut from its
surface. A way is a method, then the `refine` of the recipe, if not the default one, then any `key=value` of
`[synthesis]`, and `@N` for the `refine` of the atlas, as in `texton:2:order="region-growing"` or `jump-map:2:@2`. With
--keep pictures and figures stay, and what is there is not made again. Needs numpy, scipy, pillow and the shared data;
says so and stops with success where these are absent.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import flat

TOOLS = flat.SHARED / "tools"
# Side of a square of the area of a mesh, in texels.
SIDE = 600
# Sides of atlases. Planes are read back bilinearly: of 1024 pixels that takes contrast from any picture, of 4096 none.
PLANE_ATLAS, MESH_ATLAS = 4096, 2048
# Figures of a plane (against the peers' flat ones) and of a mesh; the lower the better.
PLANE, MESH = ["swd", "coherence_p95"], ["ratio", "p95"]


def run(*command):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


def mesh_and_scale(folder, mesh):
    """File of a mesh and its scale in texels per unit, as text."""
    if mesh.startswith("plane"):
        path = folder / f"{mesh}.glb"
        if not path.exists():
            run(sys.executable, TOOLS / "surface_quality.py", "plane", "--cells", mesh[5:], path)
        return path, f"{flat.SIDE}.0"
    path = flat.SHARED / f"data/meshes/glb/{mesh}.glb"
    sys.path.insert(0, str(TOOLS))
    import numpy as np
    from glb import Glb

    area = 0.0
    for p in Glb(path).primitives():
        a, b, c = (p["POSITION"][p["faces"][:, k]].astype(float) for k in range(3))
        area += np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    return path, f"{SIDE / area**0.5:.3f}"


def recipe(way, mesh, scale, exemplar):
    """A recipe; planes get an atlas finer than the exemplar, whose resampling does not show."""
    method, *more = way.split(":")
    atlas = "".join(f", refine = {m[1:]}" for m in more if m.startswith("@"))
    more = [m for m in more if not m.startswith("@")]
    keys = [m if "=" in m else f"refine = {m}" for m in more if m]
    size = PLANE_ATLAS if mesh.name.startswith("plane") else MESH_ATLAS
    return "\n".join([
        "kiln = 1", f'mesh.path = "{mesh}"', f'exemplar.base_color = "{exemplar}"', f'analysis.method = "{method}"',
        f"atlas = {{ size = {size}, gutter = 4, mips = false{atlas} }}", "[synthesis]", f"scale = {scale}", *keys, "",
    ])


def measure(job):
    """Figures of one bake, or of one flat synthesis."""
    kiln, folder, name, way, mesh, scale = job
    exemplar = flat.SHARED / "data/textures" / name
    stem = f"{Path(name).stem}.{mesh}.{way}".replace('"', "").replace(":", "-").replace("=", "-")
    if way == "flat":
        png = folder / f"{stem}.png"
        return job, flat.measure((kiln, [], name, "1", png))[2]
    baked = folder / "out" / stem / f"{stem}.glb"
    if not mesh.startswith("plane"):
        return job, json.loads(run(sys.executable, TOOLS / "surface_quality.py", "patches", baked, exemplar, "--scale", scale, "--json"))
    png = folder / f"{stem}.png"
    run(sys.executable, TOOLS / "surface_quality.py", "unroll", baked, png)
    quality = flat.tool()
    return job, quality.measure(quality.load(exemplar), quality.load(png))


def make(kiln, folder, names, ways, meshes, rows):
    """Bakes and measures what has no figures yet."""
    recipes = folder / "recipes"
    recipes.mkdir(parents=True, exist_ok=True)
    (folder / "kiln.toml").write_text("")
    for old in recipes.glob("*.toml"):
        old.unlink()
    jobs = [(kiln, folder, n, "flat", "plane", "") for n in names if f"{n} plane flat" not in rows]
    for mesh in meshes:
        path, scale = mesh_and_scale(folder, mesh)
        for name, way in ((n, w) for n in names for w in ways if f"{n} {mesh} {w}" not in rows):
            stem = f"{Path(name).stem}.{mesh}.{way}".replace('"', "").replace(":", "-").replace("=", "-")
            (recipes / f"{stem}.toml").write_text(recipe(way, path, scale, flat.SHARED / "data/textures" / name))
            jobs.append((kiln, folder, name, way, mesh, scale))
    if any(recipes.iterdir()):
        run(kiln, "-C", folder, "bake", "-q")
    with ProcessPoolExecutor(2) as pool:
        for (_, _, name, way, mesh, _), figures in pool.map(measure, jobs):
            rows[f"{name} {mesh} {way}"] = figures
            (folder / "figures.json").write_text(json.dumps(rows, indent=1))


def ratio(pairs):
    return f"{flat.geometric_mean(a / b for a, b in pairs):.3f}" if pairs else "-"


def table(anchors, rows, names, ways, mesh):
    """One mesh: figures of each exemplar by each way, * the best way's; then ratios to what is flat."""
    plane = mesh.startswith("plane")
    figures = PLANE if plane else MESH
    print(f"\n{mesh}: {', '.join(figures)}\n{'exemplar':22}" + "".join(f"{w:>20}" for w in ways) + ("      flat kiln    better peer" if plane else ""))
    for n in names:
        line = f"{n:22}"
        for w in ways:
            mine = [rows[f"{n} {mesh} {w}"][f] for f in figures]
            best = [min(rows[f"{n} {mesh} {v}"][f] for v in ways) for f in figures]
            line += "  " + "".join(f"{a:8.3g}{'*' if a == b and len(ways) > 1 else ' '}" for a, b in zip(mine, best))
        if plane:
            others = [rows[f"{n} plane flat"][f] for f in figures]
            others += [min(p[f] for p in anchors[n].values()) for f in figures if n in anchors]
            line += "".join(f"{x:8.3g}" for x in others)
        print(line)
    for w in ways:
        ratios = []
        for f in figures:
            mine = [rows[f"{n} {mesh} {w}"][f] for n in names]
            if plane:
                flats = [(a, rows[f"{n} plane flat"][f]) for a, n in zip(mine, names)]
                peers = [(a, min(p[f] for p in anchors[n].values())) for a, n in zip(mine, names) if n in anchors]
                text = f"{ratio(flats)} of flat kiln's, {ratio(peers)} of the better peer's (better on {sum(a < b for a, b in peers)})"
            else:
                text = f"mean {sum(mine) / len(mine):.3f}"
            wins = sum(a == min(rows[f"{n} {mesh} {v}"][f] for v in ways) for a, n in zip(mine, names))
            ratios.append(f"{f} {text}, best way on {wins} of {len(names)}")
        print(f"{w}: " + "; ".join(ratios))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kiln", default=flat.ROOT / "target/release/kiln", help="the program to measure")
    parser.add_argument("--keep", help="folder that keeps pictures and figures")
    parser.add_argument("--only", default="", help="comma-separated: textures whose names begin so, also those without peers' figures")
    parser.add_argument("--ways", default="jump-map:0,jump-map,texton", help="comma-separated: methods, see above")
    parser.add_argument("--meshes", default="plane48,plane160", help="comma-separated: planeN or names of meshes/glb")
    args = parser.parse_args()
    if not flat.SHARED.is_dir():
        print("skipped: the shared data are not beside the project")
        return 0
    anchors = json.loads((flat.SHARED / "data/anchors.json").read_text())
    names = list(anchors)
    if args.only:
        textures = sorted(p.name for p in (flat.SHARED / "data/textures").glob("*.png"))
        names = [n for n in textures if any(n.startswith(o) for o in args.only.split(","))]
    ways, meshes = args.ways.split(","), args.meshes.split(",")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(args.keep or scratch).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        kept = folder / "figures.json"
        rows = json.loads(kept.read_text()) if kept.exists() else {}
        make(Path(args.kiln).resolve(), folder, names, ways, meshes, rows)
    for mesh in meshes:
        table(anchors, rows, names, ways, mesh)
    return 0


if __name__ == "__main__":
    sys.exit(main())
