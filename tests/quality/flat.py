#!/usr/bin/env python3
"""Table of the quality of flat synthesis against two peers, on the sixteen exemplars that have peers' figures.

    tests/quality/flat.py [--kiln FILE] [--keep DIR] [--seeds 1,2,3] [-- FLAGS OF kiln synth ...]

Synthesises 256 x 256 from each exemplar with `kiln synth`, measures it with the measuring tool beside the project and
prints, per exemplar, kiln's figures (the median over the seeds) and the better peer's, then what the project promises:
exemplars on which swd and coherence_p95 are better, and the geometric means of the ratios. Needs numpy, scipy, pillow
and the shared data; says so and stops with success where these are absent. Exits with 1 where a promise is broken.
"""

import argparse
import importlib.util
import json
import math
import statistics
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared"
FIGURES = ["swd", "coherence_p95", "complete_mean", "evenness"]
SIDE = 256
# What issue-tracker and README promise of flat synthesis.
LEAST_WINS = 12
LARGEST_RATIO = 0.8


def tool():
    """The measuring tool as a module."""
    spec = importlib.util.spec_from_file_location("texture_quality", SHARED / "tools/texture_quality.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def measure(job):
    """Figures of one output of kiln."""
    kiln, flags, name, seed, out = job
    exemplar = SHARED / "data/textures" / name
    quality = tool()
    if not kiln:
        return name, seed, quality.measure(quality.load(exemplar), quality.load(out))
    command = [kiln, "synth", exemplar, "-o", out, "--size", f"{SIDE}x{SIDE}", "--seed", seed, "-j", "1", "-q", *flags]
    subprocess.run([str(c) for c in command], check=True)
    return name, seed, quality.measure(quality.load(exemplar), quality.load(out))


def better(figure, a, b):
    """True if a is better than b."""
    return a > b if figure == "evenness" else a < b


def geometric_mean(values):
    values = list(values)
    return math.exp(sum(math.log(max(v, 0.01)) for v in values) / len(values))


def medians(figures):
    """The median over the seeds of each figure."""
    return {f: statistics.median(r[f] for r in figures) for f in FIGURES}


def versus(rows, others):
    """Prints how these figures compare with those of another run, over the exemplars of both."""
    names = [n for n in rows if n in others]
    for f in FIGURES:
        pairs = [(medians(rows[n])[f], medians(others[n])[f]) for n in names]
        ratio = geometric_mean(max(a, 0.01) / max(b, 0.01) for a, b in pairs)
        wins = sum(better(f, a, b) for a, b in pairs)
        print(f"{f}: {ratio:.3f} of the other run's, better on {wins} of {len(names)}")


def table(anchors, rows):
    """Prints the comparison and returns the broken promises."""
    head = f"{'exemplar':22}" + "".join(f"{f:>16}{'peer':>8}" for f in FIGURES)
    print(head)
    ratios = {f: [] for f in FIGURES}
    for name, figures in rows.items():
        line = f"{name:22}"
        for f in FIGURES:
            kiln = medians(figures)[f]
            peers = [p[f] for p in anchors[name].values()]
            peer = max(peers) if f == "evenness" else min(peers)
            ratios[f].append((kiln, peer))
            line += f"{kiln:>15.3g}{'*' if better(f, kiln, peer) else ' '}{peer:>8.3g}"
        print(line)
    broken = []
    count = len(rows)
    for f in ["swd", "coherence_p95"]:
        wins = sum(better(f, a, b) for a, b in ratios[f])
        mean = geometric_mean(max(a, 0.01) / b for a, b in ratios[f])
        print(f"{f}: better on {wins} of {count}, geometric mean of the ratios {mean:.3f}")
        if wins < LEAST_WINS * count / 16 or mean > LARGEST_RATIO:
            broken.append(f)
    for f in ["complete_mean", "evenness"]:
        kiln, peer = (sum(column) / count for column in zip(*ratios[f]))
        print(f"{f}: mean {kiln:.3f}, the better peer's {peer:.3f}")
        if better(f, peer, kiln):
            broken.append(f)
    return broken


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kiln", default=ROOT / "target/release/kiln", help="the program to measure")
    parser.add_argument("--keep", help="folder that keeps the pictures")
    parser.add_argument("--measure", action="store_true", help="measure the pictures in the folder, make none")
    parser.add_argument("--seeds", default="1", help="comma-separated; the median over them is judged")
    parser.add_argument("--all", action="store_true", help="all textures of up to 512 pixels, also those without peers' figures")
    parser.add_argument("--versus", help="figures of another run (--json) to compare with")
    parser.add_argument("--only", help="measure exemplars whose names contain this")
    parser.add_argument("--json", help="write all figures to this file")
    parser.add_argument("flags", nargs="*", help="passed to kiln synth")
    args = parser.parse_args()
    if not SHARED.is_dir():
        print("skipped: the shared data are not beside the project")
        return 0
    anchors = json.loads((SHARED / "data/anchors.json").read_text())
    textures = SHARED / "data/textures"
    small = [p.name for p in sorted(textures.glob("*.*")) if "1024" not in p.name]
    names = [n for n in (small if args.all else anchors) if not args.only or args.only in n]
    with tempfile.TemporaryDirectory() as scratch, ProcessPoolExecutor(2) as pool:
        folder = Path(args.keep or scratch)
        folder.mkdir(parents=True, exist_ok=True)
        seeds = args.seeds.split(",")
        jobs = [(None if args.measure else args.kiln, args.flags, n, s, folder / f"{Path(n).stem}.{s}.png") for n in names for s in seeds]
        rows = {n: [] for n in names}
        for name, _, figures in pool.map(measure, jobs):
            rows[name].append(figures)
    if args.json:
        Path(args.json).write_text(json.dumps(rows, indent=1))
    if args.versus:
        versus(rows, json.loads(Path(args.versus).read_text()))
    if args.all:
        for f in FIGURES:
            print(f"{f}: geometric mean {geometric_mean(medians(r)[f] for r in rows.values()):.4g}")
    broken = table(anchors, {n: r for n, r in rows.items() if n in anchors})
    print(f"not reached: {', '.join(broken)}" if broken else "all promises kept")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
