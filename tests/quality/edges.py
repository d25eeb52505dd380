#!/usr/bin/env python3
"""Table of the continuity of textons over the edges of a mesh, before anything is blended.

    tests/quality/edges.py [--kiln FILE] [--keep DIR] [--only basket,granite] [--mesh spot]

The mean difference of the colours (0..1 per channel, as displayed) on the two sides of all edges, weighted by their
lengths: of the published method (`refine = 0`), of the default, of faces placed at random, and of the best that any place
of the face beyond could do for an edge alone (every whole shift is tried for a sample of the default's edges; where the
default itself is better, between texels, it counts). Needs numpy, pillow and the shared data; says so and stops with
success where these are absent.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import flat
import surface

WAYS = {"published": "refine = 0", "default": "refine = 2"}
# Edges whose best possible place is searched.
SAMPLED = 200


def edges(np, baked, size):
    """Corners of all faces in texels, and the edges of two faces as (face, corner, face, corner)."""
    from glb import Glb

    corners, places, starts = [], [], 0
    for p in Glb(baked).primitives():
        corners.append(p["TEXCOORD_0"][p["faces"]].astype(float) * size)
        places.append(p["POSITION"][p["faces"]])
    corners, places = np.concatenate(corners), np.concatenate(places)
    _, vertex = np.unique(places.reshape(-1, 3), axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    there, found = {}, []
    for f, face in enumerate(vertex):
        for k in range(3):
            a, b = face[k], face[(k + 1) % 3]
            other = there.pop((b, a), None)
            if other:
                found.append((f, k, *other))
            else:
                there[a, b] = (f, k)
    return corners, np.array(found)


def look(np, image, at):
    """Bilinear colours at points."""
    h, w = image.shape[:2]
    x, y = np.clip(at[..., 0] - 0.5, 0, w - 1), np.clip(at[..., 1] - 0.5, 0, h - 1)
    i, j = np.minimum(x.astype(int), w - 2), np.minimum(y.astype(int), h - 2)
    u, v = (x - i)[..., None], (y - j)[..., None]
    top = image[j, i] * (1 - u) + image[j, i + 1] * u
    return top * (1 - v) + (image[j + 1, i] * (1 - u) + image[j + 1, i + 1] * u) * v


def along(np, a, b, n):
    """n points of each segment."""
    t = ((np.arange(n) + 0.5) / n)[:, None]
    return a[..., None, :] * (1 - t) + b[..., None, :] * t


def errors(np, image, corners, pairs):
    """Difference over each edge, from eight points, and its length in texels."""
    f, k, g, j = pairs.T
    one = look(np, image, along(np, corners[f, k], corners[f, (k + 1) % 3], 8))
    other = look(np, image, along(np, corners[g, (j + 1) % 3], corners[g, j], 8))
    length = np.linalg.norm(corners[f, k] - corners[f, (k + 1) % 3], axis=1)
    return np.linalg.norm(one - other, axis=2).mean(1), length


def shuffled(np, corners, size, rng):
    """Every face at a random place inside."""
    low, high = corners.min(1) - 0.5, size - 0.5 - corners.max(1)
    return corners + (-low + rng.random(low.shape) * (high + low))[:, None, :]


def best(np, image, corners, pair, found):
    """The least difference over an edge that a whole shift of the face beyond gives."""
    f, k, g, j = pair
    size = np.array([image.shape[1], image.shape[0]])
    ours = look(np, image, along(np, corners[f, k], corners[f, (k + 1) % 3], 8))
    here = corners[g] + (corners[f, k] + corners[f, (k + 1) % 3] - corners[g, (j + 1) % 3] - corners[g, j]) / 2
    low, high = np.ceil(0.5 - here.min(0)), np.floor(size - 0.5 - here.max(0))
    if (low > high).any():
        return found
    points = along(np, here[(j + 1) % 3], here[j], 8)
    x, y = np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1)
    total = np.zeros((len(y), len(x)))
    for p, ours in zip(points, ours):
        rows, columns = p[1] + y, p[0] + x
        grid = np.stack(np.meshgrid(columns, rows), axis=2)
        total += np.linalg.norm(look(np, image, grid) - ours, axis=2)
    return min(found, total.min() / len(points))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kiln", default=flat.ROOT / "target/release/kiln", help="the program to measure")
    parser.add_argument("--keep", help="folder that keeps what is baked")
    parser.add_argument("--only", default="", help="comma-separated: textures whose names begin so")
    parser.add_argument("--mesh", default="spot", help="a name of meshes/glb")
    args = parser.parse_args()
    if not flat.SHARED.is_dir():
        print("skipped: the shared data are not beside the project")
        return 0
    sys.path.insert(0, str(surface.TOOLS))
    import numpy as np
    from PIL import Image

    textures = sorted((flat.SHARED / "data/textures").glob("*.png"))
    textures = [t for t in textures if any(t.name.startswith(o) for o in args.only.split(","))]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(args.keep or scratch).resolve()
        recipes = folder / "recipes"
        recipes.mkdir(parents=True, exist_ok=True)
        (folder / "kiln.toml").write_text("")
        path, scale = surface.mesh_and_scale(folder, args.mesh)
        for texture in textures:
            for way, keys in WAYS.items():
                (recipes / f"{texture.stem}.{way}.toml").write_text("\n".join([
                    "kiln = 1", f'mesh.path = "{path}"', f'exemplar.base_color = "{texture}"', 'analysis.method = "texton"',
                    "[uv_sets]", "[synthesis]", f"scale = {scale}", 'blend = "none"', keys, "",
                ]))
        surface.run(Path(args.kiln).resolve(), "-C", folder, "bake", "-q")
        print(f"{args.mesh}\n{'exemplar':22}{'edges':>8}{'random':>10}{'published':>11}{'default':>9}{'best':>8}")
        for texture in textures:
            image = np.asarray(Image.open(texture).convert("RGB"), float) / 255
            size, rng = np.array([image.shape[1], image.shape[0]]), np.random.default_rng(1)
            figures = {}
            for way in WAYS:
                stem = f"{texture.stem}.{way}"
                corners, pairs = edges(np, folder / "out" / stem / f"{stem}.uvsets.glb", size)
                e, length = errors(np, image, corners, pairs)
                figures[way] = (e * length).sum() / length.sum()
                if way == "published":
                    chance, _ = errors(np, image, shuffled(np, corners, size, rng), pairs)
                    figures["random"] = (chance * length).sum() / length.sum()
            some = rng.choice(len(pairs), min(SAMPLED, len(pairs)), replace=False)
            least = [best(np, image, corners, pairs[i], e[i]) for i in some]
            figures["best"] = (least * length[some]).sum() / length[some].sum()
            print(f"{texture.stem:22}{len(pairs):8}" + "".join(
                f"{figures[c]:{w}.4f}" for c, w in [("random", 10), ("published", 11), ("default", 9), ("best", 8)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
