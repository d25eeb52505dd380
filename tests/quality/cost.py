#!/usr/bin/env python3
"""How the cost of flat synthesis grows: a table and a plot.

    tests/quality/cost.py [--kiln FILE] [--plot FILE.svg] [--largest 8192]

Times `kiln synth`, whole process: exemplars of 64 to 1024 pixels for an output of 256, and outputs of 256 to 8192 from one
exemplar of 128, with and without correction. The median of three runs; exemplars are cut out of the shared data. Needs
pillow, and the shared data beside the project; says so and stops with success where these are absent.
"""

import argparse
import math
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TEXTURES = ROOT.parent / "shared/data/textures"
LARGE = "rocky-trail_1024.jpg"


def timed(kiln, exemplar, out, side, flags, runs):
    """Median of the seconds of the whole process."""
    command = [kiln, "synth", exemplar, "-o", out, "--size", f"{side}x{side}", "-q", *flags]
    seconds = []
    for _ in range(runs):
        start = time.monotonic()
        subprocess.run([str(c) for c in command], check=True)
        seconds.append(time.monotonic() - start)
    return statistics.median(seconds)


def plot(series, path):
    """Writes curves as a plot with logarithmic axes; `series`: name -> [(side, seconds)]."""
    width, height, left, bottom = 640, 400, 70, 50
    points = [p for curve in series.values() for p in curve]
    lows = [math.floor(math.log2(min(p[0] for p in points))), math.floor(math.log10(min(p[1] for p in points)))]
    highs = [math.ceil(math.log2(max(p[0] for p in points))), math.ceil(math.log10(max(p[1] for p in points)))]

    def place(side, seconds):
        x = left + (math.log2(side) - lows[0]) / (highs[0] - lows[0]) * (width - left - 130)
        y = height - bottom - (math.log10(seconds) - lows[1]) / (highs[1] - lows[1]) * (height - bottom - 20)
        return x, y

    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" font-size="12">',
           f'<rect width="{width}" height="{height}" fill="white"/>']
    for power in range(lows[0], highs[0] + 1):
        x, y = place(2**power, 10**lows[1])
        out.append(f'<text x="{x:.0f}" y="{y + 18:.0f}" text-anchor="middle">{2**power}</text>')
        out.append(f'<line x1="{x:.0f}" y1="{y:.0f}" x2="{x:.0f}" y2="20" stroke="#ddd"/>')
    for power in range(lows[1], highs[1] + 1):
        x, y = place(2**lows[0], 10**power)
        out.append(f'<text x="{x - 8:.0f}" y="{y + 4:.0f}" text-anchor="end">{10.0**power:g} s</text>')
        out.append(f'<line x1="{x:.0f}" y1="{y:.0f}" x2="{width - 130}" y2="{y:.0f}" stroke="#ddd"/>')
    labels = []
    for (name, curve), colour in zip(series.items(), ["#06c", "#c60", "#093", "#909"]):
        at = [place(*p) for p in curve]
        out.append(f'<polyline fill="none" stroke="{colour}" stroke-width="2" points="{" ".join(f"{x:.0f},{y:.0f}" for x, y in at)}"/>')
        x, y = at[-1][0] + 6, at[-1][1] + 4
        while any(x == other[0] and abs(y - other[1]) < 14 for other in labels):
            y += 2
        labels.append((x, y))
        out.append(f'<text x="{x:.0f}" y="{y:.0f}" fill="{colour}">{name}</text>')
    out.append(f'<text x="{left}" y="{height - 10}">side in pixels</text></svg>')
    Path(path).write_text("\n".join(out) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kiln", default=ROOT / "target/release/kiln", help="the program to measure")
    parser.add_argument("--plot", help="write a plot to this SVG file")
    parser.add_argument("--largest", type=int, default=8192, help="largest output")
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    if not (TEXTURES / LARGE).is_file():
        print("skipped: the shared data are not beside the project")
        return 0
    from PIL import Image

    series = {}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.png"
        exemplar = {}
        for side in [64, 128, 256, 512, 1024]:
            exemplar[side] = Path(folder) / f"{side}.png"
            Image.open(TEXTURES / LARGE).convert("RGB").crop((0, 0, side, side)).save(exemplar[side])
        print(f"{'exemplar':>8} {'output':>6} {'refine 0':>9} {'refine 2':>9}   seconds, whole process")
        jobs = [("exemplar", e, 256) for e in exemplar]
        side = 256
        while side <= args.largest:
            jobs.append(("output", 128, side))
            side *= 2
        for what, e, o in jobs:
            row = []
            for refine in ["0", "2"]:
                seconds = timed(args.kiln, exemplar[e], out, o, ["--refine", refine], 1 if o > 2048 else args.runs)
                series.setdefault(f"{what}, refine {refine}", []).append((e if what == "exemplar" else o, seconds))
                row.append(seconds)
            print(f"{e:>8} {o:>6} {row[0]:>9.3f} {row[1]:>9.3f}", flush=True)
    if args.plot:
        plot(series, args.plot)
    return 0


if __name__ == "__main__":
    sys.exit(main())
