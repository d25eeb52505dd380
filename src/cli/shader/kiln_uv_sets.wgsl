// kiln: reference consumer of UV sets, WGSL.
//
// Vertex inputs: TEXCOORD_0..n-1 (vec2f, one per set) and _KILN_WEIGHTS (vec4f, normalised), passed on as ordinary varyings.
// `sets` 1..4 and `blend` (0 "linear", 1 "variance", 2 "none") stand in the KILN_uv_sets extension object of the material
// (and in extras.kiln), like `sharpness` and `size`, its exemplarSize. `mean` is the extension's mean of the map that is sampled. Call from uniform control flow.

struct KilnSets {
    uv: array<vec2f, 4>,
    weights: vec4f,
    sets: i32,
    blend: i32,
    sharpness: f32,
    size: vec2f,
}

// The weights that are applied: all of them, sharpened, or the greatest alone.
fn kiln_weights(s: KilnSets) -> vec4f {
    let p = pow(max(s.weights, vec4f(0.0)), vec4f(s.sharpness));
    let w = p / max(dot(p, vec4f(1.0)), 1e-6);
    if (s.blend != 2) { return w; }
    let top = max(max(w.x, w.y), max(w.z, w.w));
    if (w.x == top) { return vec4f(1.0, 0.0, 0.0, 0.0); }
    if (w.y == top) { return vec4f(0.0, 1.0, 0.0, 0.0); }
    if (w.z == top) { return vec4f(0.0, 0.0, 1.0, 0.0); }
    return vec4f(0.0, 0.0, 0.0, 1.0);
}

// Texton bakes: leaves the blend out where the edge that it hides would be hardly visible (Magda, Kriegman 2003, Eq. 4).
// `edge` is the attribute _KILN_EDGE (vec2: mean difference of colours along the edge, length of the edge in world units;
// equal at all corners of a triangle), `lambda` the pixels across the view by its angle in radians, `distance` that of
// the fragment from the eye in world units, `threshold` what may stay visible, in pixels times difference (try 2).
fn kiln_at_distance(s: KilnSets, edge: vec2f, lambda: f32, distance: f32, threshold: f32) -> KilnSets {
    var out = s;
    if (lambda * edge.x * edge.y <= threshold * distance) { out.weights = vec4f(1.0, 0.0, 0.0, 0.0); }
    return out;
}

// Places within two texels of each other are alike.
fn kiln_alike(s: KilnSets, a: vec2f, b: vec2f) -> f32 {
    return max(1.0 - length((a - b) * s.size) / 2.0, 0.0);
}

// Share of one sample's variance that a mean by these weights has.
fn kiln_variance(s: KilnSets, w: vec4f) -> f32 {
    let two = w.x * w.y * kiln_alike(s, s.uv[0], s.uv[1]);
    let three = w.z * (w.x * kiln_alike(s, s.uv[0], s.uv[2]) + w.y * kiln_alike(s, s.uv[1], s.uv[2]));
    let far = w.x * kiln_alike(s, s.uv[0], s.uv[3]) + w.y * kiln_alike(s, s.uv[1], s.uv[3]);
    let four = w.w * (far + w.z * kiln_alike(s, s.uv[2], s.uv[3]));
    let pairs = select(0.0, two, s.sets > 1) + select(0.0, three, s.sets > 2) + select(0.0, four, s.sets > 3);
    return max(dot(w, w) + 2.0 * pairs, 1e-6);
}

// One map, blended.
fn kiln_sample(map: texture_2d<f32>, sampler_: sampler, s: KilnSets, mean: vec4f) -> vec4f {
    let w = kiln_weights(s);
    // Every set is sampled, so that the gradients are those of uniform control flow; unused ones weigh nothing.
    let a = textureSample(map, sampler_, s.uv[0]) * w.x;
    let b = textureSample(map, sampler_, s.uv[1]) * select(0.0, w.y, s.sets > 1);
    let c = textureSample(map, sampler_, s.uv[2]) * select(0.0, w.z, s.sets > 2);
    let d = textureSample(map, sampler_, s.uv[3]) * select(0.0, w.w, s.sets > 3);
    let sum = a + b + c + d;
    let stretched = mean + (sum - mean) * inverseSqrt(kiln_variance(s, w));
    return select(sum, stretched, s.blend == 1);
}

// The part of one set in the world-space normal: its own frame, from the gradients of its coordinates.
fn kiln_turned(m: vec3f, uv: vec2f, n: vec3f, position: vec3f) -> vec3f {
    let px = dpdx(position);
    let py = dpdy(position);
    let ux = dpdx(uv);
    let uy = dpdy(uv);
    // Direction in which u grows and, as v points down, against which v grows.
    let turn = sign(ux.x * uy.y - uy.x * ux.y);
    var t = (px * uy.y - py * ux.y) * turn;
    var b = (px * uy.x - py * ux.x) * turn;
    t = t - n * dot(n, t);
    b = b - n * dot(n, b);
    t = t * inverseSqrt(max(dot(t, t), 1e-20));
    b = b * inverseSqrt(max(dot(b, b), 1e-20));
    return t * m.x + b * m.y + n * m.z;
}

// World-space normal from the sample's normal map.
// Pass the normal as the mesh has it, also on back faces, and negate the result there (doubleSided materials).
fn kiln_normal(map: texture_2d<f32>, sampler_: sampler, s: KilnSets, normal: vec3f, position: vec3f) -> vec3f {
    let w = kiln_weights(s);
    let n = normalize(normal);
    let a = kiln_turned(textureSample(map, sampler_, s.uv[0]).xyz * 2.0 - 1.0, s.uv[0], n, position) * w.x;
    let b = kiln_turned(textureSample(map, sampler_, s.uv[1]).xyz * 2.0 - 1.0, s.uv[1], n, position);
    let c = kiln_turned(textureSample(map, sampler_, s.uv[2]).xyz * 2.0 - 1.0, s.uv[2], n, position);
    let d = kiln_turned(textureSample(map, sampler_, s.uv[3]).xyz * 2.0 - 1.0, s.uv[3], n, position);
    return normalize(a + b * select(0.0, w.y, s.sets > 1) + c * select(0.0, w.z, s.sets > 2)
        + d * select(0.0, w.w, s.sets > 3));
}

// Material-space bakes have two primitives for each of the input's: `sets` is 1 for the material of one (nearly all of it) and
// 3 for that of the other.
// Material-space bakes: the file that the extension names as `tile` holds the layers, as a 3D texture or (analysis.tile =
// "2d-array") a 2D array; the sampler repeats in s and t and clamps along m. `m` is the attribute _KILN_MATERIAL (f32,
// passed on), `layers` the extension's. Use these in place of kiln_sample and kiln_normal:
// kiln_blend_tile(s, kiln_tile_3d(tile, sampler_, s, m, layers)), and likewise.
fn kiln_layer_3d(tile: texture_3d<f32>, sampler_: sampler, uv: vec2f, m: f32, layers: f32) -> vec4f {
    return textureSample(tile, sampler_, vec3f(uv, (saturate(m) * (layers - 1.0) + 0.5) / layers));
}

fn kiln_layer_array(tile: texture_2d_array<f32>, sampler_: sampler, uv: vec2f, m: f32, layers: f32) -> vec4f {
    let z = saturate(m) * (layers - 1.0);
    let below = floor(z);
    let a = textureSample(tile, sampler_, uv, i32(below));
    let b = textureSample(tile, sampler_, uv, i32(min(below + 1.0, layers - 1.0)));
    return mix(a, b, z - below);
}

// What the sets show, blended; `sample` holds one look-up per set (unused ones weigh nothing).
fn kiln_blend_tile(s: KilnSets, sample: array<vec4f, 4>) -> vec4f {
    let w = kiln_weights(s);
    return sample[0] * w.x + sample[1] * select(0.0, w.y, s.sets > 1) + sample[2] * select(0.0, w.z, s.sets > 2)
        + sample[3] * select(0.0, w.w, s.sets > 3);
}

fn kiln_blend_tile_normal(s: KilnSets, sample: array<vec4f, 4>, normal: vec3f, position: vec3f) -> vec3f {
    let n = normalize(normal);
    let w = kiln_weights(s);
    let a = kiln_turned(sample[0].xyz * 2.0 - 1.0, s.uv[0], n, position) * w.x;
    let b = kiln_turned(sample[1].xyz * 2.0 - 1.0, s.uv[1], n, position) * select(0.0, w.y, s.sets > 1);
    let c = kiln_turned(sample[2].xyz * 2.0 - 1.0, s.uv[2], n, position) * select(0.0, w.z, s.sets > 2);
    let d = kiln_turned(sample[3].xyz * 2.0 - 1.0, s.uv[3], n, position) * select(0.0, w.w, s.sets > 3);
    return normalize(a + b + c + d);
}

fn kiln_tile_3d(tile: texture_3d<f32>, sampler_: sampler, s: KilnSets, m: f32, layers: f32) -> array<vec4f, 4> {
    return array<vec4f, 4>(
        kiln_layer_3d(tile, sampler_, s.uv[0], m, layers), kiln_layer_3d(tile, sampler_, s.uv[1], m, layers),
        kiln_layer_3d(tile, sampler_, s.uv[2], m, layers), kiln_layer_3d(tile, sampler_, s.uv[3], m, layers));
}

fn kiln_tile_array(tile: texture_2d_array<f32>, sampler_: sampler, s: KilnSets, m: f32, layers: f32) -> array<vec4f, 4> {
    return array<vec4f, 4>(
        kiln_layer_array(tile, sampler_, s.uv[0], m, layers), kiln_layer_array(tile, sampler_, s.uv[1], m, layers),
        kiln_layer_array(tile, sampler_, s.uv[2], m, layers), kiln_layer_array(tile, sampler_, s.uv[3], m, layers));
}
