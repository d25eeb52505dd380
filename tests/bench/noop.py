#!/usr/bin/env python3
"""How long `kiln bake` takes when there is nothing to do, beside ninja on a graph of as many edges.

    tests/bench/noop.py KILN [STEPS...]          default: 100 1000 10000 100000

Generates recipes over shared meshes and samples, half of them canvases and half meshes, each with three steps of its own,
bakes them once, and runs both programs again: whole processes, the best of five. ninja's graph has as many edges as kiln
has steps, one output each, and the same number of inputs. `long way` is kiln without its seal (`.kiln/seal`): recipes
are parsed and the graph is made. `touched` is a run after one sample of 8 got another time but the same content.

A last column proves the cone: one sample is changed, and exactly the recipes that use it may run.
"""
import os, random, shutil, struct, subprocess, sys, tempfile, time, zlib
from pathlib import Path

SAMPLES, MESHES = 8, 4
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 {}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def png(path, seed, side=16):
    rng = random.Random(seed)
    rows = b"".join(b"\0" + rng.randbytes(side * 3) for _ in range(side))
    chunk = lambda tag, data: struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))
    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    data = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + data)


def recipe(i):
    sample = f'[exemplar]\nbase_color = "../assets/{i % SAMPLES}.png"\n[analysis]\nneighbourhoods = [3]\n'
    walk = f"[synthesis]\nrefine = 0\nseed = {i}\n"
    if i % 2:
        return sample + walk + "[canvas]\nsize = [8, 8]\n"
    return sample + walk + f'scale = 12.0\n[mesh]\npath = "../assets/{i // SAMPLES % MESHES}.obj"\n[uv_sets]\n'


def murmur(key):
    """The hash of a command in ninja's log: MurmurHash64A."""
    m, mask = 0xC6A4A7935BD1E995, (1 << 64) - 1
    h = 0xDECAFBADDECAFBAD ^ (len(key) * m & mask)
    whole = len(key) // 8 * 8
    for (k,) in struct.iter_unpack("<Q", key[:whole]):
        k = k * m & mask
        h = (h ^ ((k ^ k >> 47) * m & mask)) * m & mask
    if key[whole:]:
        h = (h ^ int.from_bytes(key[whole:], "little")) * m & mask
    h = (h ^ h >> 47) * m & mask
    return h ^ h >> 47


def best(command, folder, prepare=lambda: None, runs=5):
    times = []
    for _ in range(runs):
        prepare()
        begun = time.perf_counter()
        ran = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        times.append(time.perf_counter() - begun)
        assert ran.returncode == 0, ran.stdout + ran.stderr
    return min(times), ran.stdout + ran.stderr


def age(folder):
    """Inputs that were there for a while, as they mostly are."""
    for path in [*folder.glob("recipes/*"), *folder.glob("assets/*")]:
        os.utime(path, (path.stat().st_mtime - 100,) * 2)


def bench(kiln, steps, root):
    folder = root / f"kiln-{steps}"
    (folder / "assets").mkdir(parents=True)
    (folder / "recipes").mkdir()
    for i in range(SAMPLES):
        png(folder / f"assets/{i}.png", i)
    for i in range(MESHES):
        (folder / f"assets/{i}.obj").write_text(TETRAHEDRON.format(i + 1))
    recipes = max(1, (steps - 2 * SAMPLES) // 3)
    for i in range(recipes):
        (folder / f"recipes/r{i:06}.toml").write_text(recipe(i))
    age(folder)
    begun = time.perf_counter()
    subprocess.run([kiln, "bake", "-q"], cwd=folder, check=True)
    cold = time.perf_counter() - begun
    noop, said = best([kiln, "bake"], folder)
    assert said.startswith("nothing to do"), said
    count = int(best([kiln, "plan"], folder, runs=1)[1].split()[4])
    seal = folder / ".kiln/seal"
    if not seal.exists(): print("NO SEAL"); seal.touch()
    long_way, said = best([kiln, "bake"], folder, lambda: seal.unlink(missing_ok=True))
    assert said.startswith("nothing to do"), said
    touched, said = best([kiln, "bake"], folder, (folder / "assets/0.png").touch)
    assert said.startswith("nothing to do"), said

    other = root / f"ninja-{steps}"
    other.mkdir()
    text = "rule touch\n  command = touch $out\n"
    for i in range(count):
        text += f"build out/{i}: touch in/{i % (SAMPLES + MESHES)} recipe/{i // 3}\n"
    (other / "build.ninja").write_text(text)
    for name in ("in", "recipe", "out"):
        (other / name).mkdir()
    for i in range(SAMPLES + MESHES):
        (other / f"in/{i}").touch()
    for i in range(count // 3 + 1):
        (other / f"recipe/{i}").touch()
    # As if it had been built: 100,000 processes would only take time.
    log = "# ninja log v5\n"
    for i in range(count):
        output = other / f"out/{i}"
        output.touch()
        log += f"0\t1\t{output.stat().st_mtime_ns}\tout/{i}\t{murmur(f'touch out/{i}'.encode()):x}\n"
    (other / ".ninja_log").write_text(log)
    theirs, said = best(["ninja"], other)
    assert "no work to do" in said, said

    png(folder / "assets/0.png", 99)
    plan = subprocess.run([kiln, "plan"], cwd=folder, capture_output=True, text=True).stdout
    names = {line.split()[1].split("/")[0] for line in plan.splitlines()}
    expected = {f"r{i:06}" for i in range(0, recipes, SAMPLES)}
    assert names == expected, sorted(names ^ expected)[:5]
    cone = f"{len(names)} of {recipes}"
    print(f"| {count} | {recipes} | {cold:.1f} | {noop:.4f} | {theirs:.4f} | {long_way:.3f} | {touched:.3f} | {cone} |", flush=True)
    shutil.rmtree(folder)
    shutil.rmtree(other)


def main():
    kiln = str(Path(sys.argv[1]).resolve())
    print("| steps | recipes | cold, s | no-op, s | ninja, s | long way, s | touched, s | cone of a sample, recipes |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as root:
        for steps in map(int, sys.argv[2:] or ["100", "1000", "10000", "100000"]):
            bench(kiln, steps, Path(root))


main()
