//! Small textures, jump maps and meshes for the tests of this module, by the plainest means.

use crate::exemplar::{Jump, JumpMap, JumpVolume, VolumeJump};
use crate::mesh::{Topology, TriMesh};
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::numerics::vec::{Vec2, vec2, vec3};
use crate::texture::{Texture, Wrap};

/// Random grey values.
pub fn noise(w: u32, h: u32) -> Texture {
    let key = Key::new(99);
    Texture::from_fn(w, h, 1, |x, y, out| out[0] = key.with(u64::from(y)).unit(u64::from(x)) as f32)
}

/// Smooth random blobs of two channels: noise averaged over 5 x 5 texels.
pub fn blobs(w: u32, h: u32) -> Texture {
    let fine = noise(w + 4, 2 * (h + 4));
    Texture::from_fn(w, h, 2, |x, y, out| {
        for (c, v) in out.iter_mut().enumerate() {
            let around = (0..5).flat_map(|j| (0..5).map(move |i| (i, j)));
            *v = around.map(|(i, j)| fine.get(x + i, y + j + c as u32 * (h + 4))[0]).sum();
        }
    })
}

/// \[ZG02\] section 2 by comparing every texel with every other: squares of 2r + 1 texels, k jumps that are `min_distance`
/// texels apart, probabilities by Eq. 1 with alpha = 1.1.
pub fn brute_force_map(t: &Texture, radius: i64, k: usize, min_distance: f32) -> JumpMap {
    let (w, h) = (t.width(), t.height());
    let side = (2 * radius + 1) as usize;
    let dims = side * side * t.channels() as usize;
    let vectors: Vec<Vec<f32>> = (0..t.texel_count() as i64)
        .map(|i| {
            let (x, y) = (i % i64::from(w), i / i64::from(w));
            let around = (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dx, dy)));
            let v: Vec<f32> = around
                .flat_map(|(dx, dy)| t.get(Wrap::Clamp.index(x + dx, w), Wrap::Clamp.index(y + dy, h)).to_vec())
                .collect();
            assert_eq!(v.len(), dims);
            v
        })
        .collect();
    let far = |a: usize, b: usize| {
        let d = |a: usize, b: usize| (a as f32 - b as f32) * (a as f32 - b as f32);
        let w = w as usize;
        d(a % w, b % w) + d(a / w, b / w) >= min_distance * min_distance
    };
    let matches: Vec<Vec<(f32, usize)>> = par::map(vectors.len(), |i| {
        let distance = |j: usize| vectors[i].iter().zip(&vectors[j]).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
        let mut all: Vec<(f32, usize)> = (0..vectors.len()).map(|j| (distance(j).sqrt(), j)).collect();
        all.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut accepted: Vec<(f32, usize)> = vec![];
        for (d, j) in all {
            if accepted.len() < k && far(i, j) && accepted.iter().all(|a| far(a.1, j)) {
                accepted.push((d, j));
            }
        }
        accepted
    });
    let worst = matches.iter().flatten().fold(0.0f32, |m, (d, _)| m.max(*d));
    let t = (1.1 * worst).max(1e-6);
    let jump = |&(d, j): &(f32, usize)| Jump {
        x: (j % w as usize) as u16,
        y: (j / w as usize) as u16,
        p: (t - d) / (k as f32 * t),
    };
    let rows: Vec<Vec<Jump>> = matches.iter().map(|row| row.iter().map(jump).collect()).collect();
    JumpMap::from_rows(w, h, &rows)
}

/// A flat grid of `w` x `h` vertices one unit apart, y down as in the exemplar, each square cut in two; vertices shifted
/// at random by up to `jitter`.
pub fn grid(w: u32, h: u32, jitter: f64) -> TriMesh {
    let key = Key::new(5);
    let at = |i: u32| {
        let draws = key.with(u64::from(i));
        let [dx, dy] = [0, 1].map(|d| (draws.unit(d) * 2.0 - 1.0) * jitter);
        vec3(f64::from(i % w) + dx, f64::from(i / w) + dy, 0.0)
    };
    let squares = (0..h - 1).flat_map(|y| (0..w - 1).map(move |x| y * w + x));
    let faces = squares.flat_map(|i| [[i, i + w, i + 1], [i + 1, i + w, i + w + 1]]).collect();
    TriMesh { positions: (0..w * h).map(at).collect(), faces }
}

/// Offsets of a mesh seen along z: positions' differences times the scale.
pub fn flat_offsets(mesh: &TriMesh, topology: &Topology, scale: f64) -> Vec<Vec2> {
    let p = &mesh.positions;
    let along = |v: u32| topology.neighbours(v).iter().map(move |n| p[*n as usize] - p[v as usize]);
    (0..p.len() as u32).flat_map(|v| along(v).map(|d| vec2(d.x * scale, d.y * scale))).collect()
}

/// Random offsets of up to `reach` texels along each axis, opposite for the two halves of an edge.
pub fn random_offsets(topology: &Topology, reach: f64, seed: u64) -> Vec<Vec2> {
    let draw = |a: u32, b: u32| {
        let k = Key::new(seed).with(u64::from(a.min(b))).with(u64::from(a.max(b)));
        let d = vec2(k.unit(0) * 2.0 - 1.0, k.unit(1) * 2.0 - 1.0) * reach;
        if a < b { d } else { -d }
    };
    (0..topology.vertex_count() as u32).flat_map(|v| topology.neighbours(v).iter().map(move |n| draw(v, *n))).collect()
}

/// Meshes by property, positions aside.
pub fn topologies() -> Vec<(&'static str, Topology)> {
    let mesh = |n: usize, faces: Vec<[u32; 3]>| TriMesh { positions: vec![Default::default(); n], faces };
    let ring = |i: u32, n: u32| i % n;
    let torus = (0..36u32).flat_map(|i| {
        let at = |x: u32, y: u32| ring(x, 6) + 6 * ring(y, 6);
        let (x, y) = (i % 6, i / 6);
        [[at(x, y), at(x + 1, y), at(x, y + 1)], [at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]]
    });
    let moebius = (0..7u32).flat_map(|i| {
        let (a, b) = (2 * i, 2 * i + 1);
        let (c, d) = if i == 6 { (1, 0) } else { (2 * i + 2, 2 * i + 3) };
        [[a, c, b], [b, c, d]]
    });
    vec![
        ("empty", Topology::new(&mesh(0, vec![]))),
        ("isolated", Topology::new(&mesh(3, vec![]))),
        ("tetrahedron", Topology::new(&mesh(4, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))),
        ("fan", Topology::new(&mesh(9, (1..8).map(|i| [0, i, i + 1]).collect()))),
        ("hourglass", Topology::new(&mesh(5, vec![[0, 1, 2], [0, 3, 4]]))),
        ("moebius", Topology::new(&mesh(14, moebius.collect()))),
        ("torus", Topology::new(&mesh(36, torus.collect()))),
        ("two components", Topology::new(&mesh(7, vec![[0, 1, 2], [4, 5, 6]]))),
        ("repeated corner", Topology::new(&mesh(3, vec![[0, 0, 1], [0, 1, 2]]))),
        ("grid", Topology::new(&grid(13, 9, 0.0))),
    ]
}

/// A flipbook's jump map whose texels jump to the given places with equal probability, 1 in all.
pub fn jump_volume(size: [u16; 3], to: impl Fn([u16; 3]) -> Vec<[u16; 3]>) -> JumpVolume {
    let [w, h, frames] = size.map(u32::from);
    let (mut counts, mut jumps) = (vec![], vec![]);
    for i in 0..w * h * frames {
        let row = to([(i % w) as u16, (i / w % h) as u16, (i / (w * h)) as u16]);
        counts.push(row.len() as u8);
        jumps.extend(row.iter().map(|at| VolumeJump::new(*at, 1.0 / row.len() as f64)));
    }
    JumpVolume::new([w, h, frames], &counts, jumps).expect("jumps inside")
}
