//! The sample meshes: a knot, a carved sphere, a rounded block of few large triangles, an open leaf, a toadstool of two
//! materials, a vase (OBJ, quads) and a ring (glTF with a buffer beside it). Units: about one to two across, y up.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::path::Path;

use kiln::mesh::TriMesh;
use kiln::numerics::det::{cos, sin, sin_cos};
use kiln::numerics::vec::{Vec3, vec3};
use serde_json::json;

use crate::glb::Builder;
use crate::noise::step;

pub fn write_all(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    for (name, mesh) in [("knot", knot()), ("carved-sphere", carved_sphere()), ("block", block())] {
        let mut b = Builder::default();
        let primitive = b.primitive(&mesh, None, 0);
        let scene = json!({
            "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "name": name}],
            "meshes": [{"name": name, "primitives": [primitive]}],
            "materials": [{"name": "Surface"}],
        });
        std::fs::write(folder.join(format!("{name}.glb")), b.glb(scene))?;
    }
    std::fs::write(folder.join("leaf.glb"), leaf())?;
    std::fs::write(folder.join("toadstool.glb"), toadstool())?;
    std::fs::write(folder.join("vase.obj"), vase())?;
    let mut b = Builder::default();
    let primitive = b.primitive(&ring(), None, 0);
    let (text, bin) = b.gltf(
        json!({
            "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "name": "ring"}],
            "meshes": [{"name": "ring", "primitives": [primitive]}], "materials": [{"name": "Surface"}],
        }),
        "ring.bin",
    );
    std::fs::write(folder.join("ring.gltf"), text)?;
    std::fs::write(folder.join("ring.bin"), bin)
}

/// A grid of `f(i / n, j / m)`, wrapping where told; counter-clockwise from outside if d/du x d/dv points out.
fn grid(n: u32, m: u32, wrap_u: bool, wrap_v: bool, f: impl Fn(f64, f64) -> Vec3) -> TriMesh {
    let (cols, rows) = (if wrap_u { n } else { n + 1 }, if wrap_v { m } else { m + 1 });
    let mut mesh = TriMesh::default();
    for j in 0..rows {
        for i in 0..cols {
            mesh.positions.push(f(f64::from(i) / f64::from(n), f64::from(j) / f64::from(m)));
        }
    }
    let id = |i: u32, j: u32| (j % rows) * cols + i % cols;
    for j in 0..m {
        for i in 0..n {
            let [a, b, c, d] = [id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)];
            mesh.faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// A tube of radius `r` about a closed curve.
fn tube(n: u32, m: u32, r: f64, curve: impl Fn(f64) -> Vec3) -> TriMesh {
    grid(n, m, true, true, |u, v| {
        let c = curve(u);
        let t = (curve(u + 1e-4) - curve(u - 1e-4)).normalized().unwrap_or(vec3(1.0, 0.0, 0.0));
        let side = c.reject(t).normalized().unwrap_or_else(|| t.any_perpendicular());
        let up = t.cross(side);
        let (s, k) = sin_cos(v * TAU);
        c + (side * k - up * s) * r
    })
}

/// A trefoil: 2 times around the axis, 3 times around the ring.
fn knot() -> TriMesh {
    tube(288, 20, 0.205, |u| {
        let (s2, c2) = sin_cos(2.0 * u * TAU);
        let (s3, c3) = sin_cos(3.0 * u * TAU);
        vec3((0.62 + 0.28 * c3) * c2, (0.62 + 0.28 * c3) * s2, 0.34 * s3)
    })
}

fn ring() -> TriMesh {
    tube(96, 36, 0.30, |u| vec3(0.62 * cos(u * TAU), 0.0, -0.62 * sin(u * TAU)))
}

/// An icosphere with carved spirals and a carved equator.
fn carved_sphere() -> TriMesh {
    let mut mesh = icosphere(5);
    for p in &mut mesh.positions {
        let n = *p;
        let around = kiln::numerics::det::atan2(n.z, n.x);
        let lat = kiln::numerics::det::acos(n.y);
        let spiral = sin(around * 5.0 + lat * 4.0);
        let groove = step(0.86, 0.99, spiral) * step(0.25, 0.55, sin(lat));
        let belt = step(0.10, 0.05, (lat - PI * 0.5).abs());
        *p = n * (0.75 - 0.055 * groove.max(belt));
    }
    mesh
}

fn icosphere(levels: u32) -> TriMesh {
    let g = (1.0 + 5.0f64.sqrt()) / 2.0;
    let raw = [
        (-1., g, 0.),
        (1., g, 0.),
        (-1., -g, 0.),
        (1., -g, 0.),
        (0., -1., g),
        (0., 1., g),
        (0., -1., -g),
        (0., 1., -g),
        (g, 0., -1.),
        (g, 0., 1.),
        (-g, 0., -1.),
        (-g, 0., 1.),
    ];
    let unit = |p: Vec3| p.normalized().unwrap_or(p);
    let mut mesh = TriMesh {
        positions: raw.iter().map(|&(x, y, z)| unit(vec3(x, y, z))).collect(),
        faces: vec![
            [0, 11, 5],
            [0, 5, 1],
            [0, 1, 7],
            [0, 7, 10],
            [0, 10, 11],
            [1, 5, 9],
            [5, 11, 4],
            [11, 10, 2],
            [10, 7, 6],
            [7, 1, 8],
            [3, 9, 4],
            [3, 4, 2],
            [3, 2, 6],
            [3, 6, 8],
            [3, 8, 9],
            [4, 9, 5],
            [2, 4, 11],
            [6, 2, 10],
            [8, 6, 7],
            [9, 8, 1],
        ],
    };
    for _ in 0..levels {
        let mut middle = BTreeMap::new();
        let mut faces = Vec::new();
        for &[a, b, c] in &mesh.faces {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(i, j)| {
                *middle.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    mesh.positions.push(unit(mesh.positions[i as usize] + mesh.positions[j as usize]));
                    mesh.positions.len() as u32 - 1
                })
            });
            faces.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        mesh.faces = faces;
    }
    mesh
}

/// A block with rounded edges whose six sides are each a fan of 12 large triangles.
fn block() -> TriMesh {
    const FLAT: f64 = 0.56;
    const ROUND: f64 = 0.12;
    const STEPS: i32 = 3;
    // Grid lines along one axis: round edge, three equal flat spans, round edge.
    let bend = |k: i32| FLAT + ROUND * kiln::numerics::det::tan(f64::from(k) / f64::from(STEPS) * PI / 4.0);
    let mut lines: Vec<f64> = (1..=STEPS).rev().map(|k| -bend(k)).collect();
    lines.extend([-FLAT, -FLAT / 3.0, FLAT / 3.0, FLAT]);
    lines.extend((1..=STEPS).map(bend));
    let inner = STEPS as usize..STEPS as usize + 3;
    let mut ids: BTreeMap<[i64; 3], u32> = BTreeMap::new();
    let mut mesh = TriMesh::default();
    let mut vertex = |mesh: &mut TriMesh, p: Vec3| {
        let core = vec3(p.x.clamp(-FLAT, FLAT), p.y.clamp(-FLAT, FLAT), p.z.clamp(-FLAT, FLAT));
        let out = (p - core).normalized().unwrap_or(Vec3::ZERO);
        let q = core + out * ROUND;
        *ids.entry([q.x, q.y, q.z].map(|c| (c * 1e6).round() as i64)).or_insert_with(|| {
            mesh.positions.push(q);
            mesh.positions.len() as u32 - 1
        })
    };
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            // The side's own axes, so that d/du x d/dv points out.
            let place = |u: f64, v: f64| {
                let (u, v) = if sign > 0.0 { (u, v) } else { (v, u) };
                let mut c = [0.0; 3];
                c[axis] = sign * (FLAT + ROUND);
                c[(axis + 1) % 3] = u;
                c[(axis + 2) % 3] = v;
                Vec3::from(c)
            };
            for j in 0..lines.len() - 1 {
                for i in 0..lines.len() - 1 {
                    if inner.contains(&i) && inner.contains(&j) {
                        continue;
                    }
                    let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                        .map(|(i, j)| vertex(&mut mesh, place(lines[i], lines[j])));
                    mesh.faces.extend([[a, b, c], [a, c, d]]);
                }
            }
            let (first, last) = (inner.start, inner.end);
            let mut rim: Vec<(usize, usize)> = (first..last).map(|i| (i, first)).collect();
            rim.extend((first..last).map(|j| (last, j)));
            rim.extend((first + 1..=last).rev().map(|i| (i, last)));
            rim.extend((first + 1..=last).rev().map(|j| (first, j)));
            let centre = vertex(&mut mesh, place(0.0, 0.0));
            for k in 0..rim.len() {
                let [a, b] =
                    [rim[k], rim[(k + 1) % rim.len()]].map(|(i, j)| vertex(&mut mesh, place(lines[i], lines[j])));
                mesh.faces.push([centre, a, b]);
            }
        }
    }
    mesh
}

/// An open, curved leaf with UVs, seen from both sides.
fn leaf() -> Vec<u8> {
    let shape = |u: f64, v: f64| {
        let half = 0.46 * det_pow(sin(PI * (0.02 + 0.96 * v)), 0.8) * (1.0 - 0.25 * v);
        let x = (u - 0.5) * 2.0 * half;
        let fold = 0.45 * x.abs() - 0.06 * cos((u - 0.5) * TAU * 2.0) * half;
        vec3(x, v * 1.9 - 0.95, fold - 0.35 * (v - 0.4) * (v - 0.4) + 0.05 * sin(v * 11.0) * (u - 0.5))
    };
    let (n, m) = (16, 28);
    let mesh = grid(n, m, false, false, shape);
    let uvs: Vec<[f32; 2]> =
        (0..=m).flat_map(|j| (0..=n).map(move |i| [i as f32 / n as f32, 1.0 - j as f32 / m as f32])).collect();
    let mut b = Builder::default();
    let primitive = b.primitive(&mesh, Some(&uvs), 0);
    b.glb(json!({
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "name": "leaf"}],
        "meshes": [{"name": "leaf", "primitives": [primitive]}],
        "materials": [{"name": "Leaf", "doubleSided": true}],
    }))
}

fn det_pow(x: f64, y: f64) -> f64 {
    kiln::numerics::det::pow(x.max(0.0), y)
}

/// A surface of revolution about y; `profile(t)` gives (radius, height), from the bottom to the top.
fn lathe(n: u32, m: u32, profile: impl Fn(f64) -> (f64, f64)) -> TriMesh {
    grid(n, m, true, false, |u, v| {
        let (r, y) = profile(v);
        let (s, c) = sin_cos(u * TAU);
        vec3(r * c, y, -r * s)
    })
}

/// A toadstool: cap and stem of two materials on two nodes, with a light, a camera and extras that must survive.
fn toadstool() -> Vec<u8> {
    let cap = lathe(64, 28, |t| {
        let a = t * PI * 0.62 - PI * 0.12;
        (0.015 + 0.70 * cos(a.clamp(-PI / 2.0, PI / 2.0)), 0.42 * sin(a))
    });
    let stem = lathe(40, 24, |t| (0.17 + 0.10 * (1.0 - t) * (1.0 - t) - 0.03 * sin(t * PI), t * 0.95));
    let mut b = Builder::default();
    let cap = b.primitive(&cap, None, 0);
    let stem = b.primitive(&stem, None, 1);
    b.glb(json!({
        "scene": 0,
        "scenes": [{"name": "forest", "nodes": [0, 3]}],
        "nodes": [
            {"name": "toadstool", "children": [1, 2, 4], "extras": {"edible": false}},
            {"name": "stem", "mesh": 1},
            {"name": "cap", "mesh": 0, "translation": [0.0, 0.93, 0.0], "scale": [1.1, 1.0, 1.1]},
            {"name": "view", "camera": 0, "translation": [0.0, 1.0, 3.5]},
            {"name": "sun", "translation": [2.0, 3.0, 1.0], "extensions": {"KHR_lights_punctual": {"light": 0}}},
        ],
        "meshes": [{"name": "cap", "primitives": [cap]}, {"name": "stem", "primitives": [stem]}],
        "materials": [
            {"name": "Cap"},
            {"name": "Stem", "pbrMetallicRoughness": {"baseColorFactor": [0.86, 0.80, 0.68, 1.0], "metallicFactor": 0.0}},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.01}}],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 40.0}]}},
        "extensionsUsed": ["KHR_lights_punctual"],
    }))
}

/// A vase as an OBJ of quads.
fn vase() -> String {
    let (n, m) = (48usize, 40usize);
    let mut text = String::from("# vase, made by make_samples\no vase\n");
    for j in 0..=m {
        let t = j as f64 / m as f64;
        let r = 0.24 + 0.30 * sin(PI * (0.10 + 0.80 * t)) * (1.0 - 0.55 * t) + 0.10 * step(0.86, 1.0, t);
        for i in 0..n {
            let (s, c) = sin_cos(i as f64 / n as f64 * TAU);
            let _ = writeln!(text, "v {:.6} {:.6} {:.6}", r * c, t * 1.5 - 0.75, -r * s);
        }
    }
    for j in 0..m {
        for i in 0..n {
            let id = |i: usize, j: usize| j * n + i % n + 1;
            let _ = writeln!(text, "f {} {} {} {}", id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1));
        }
    }
    text
}
