// kiln: reference consumer of UV sets, GLSL ES 3.00 / GLSL 3.30 and later.
//
// Vertex inputs: TEXCOORD_0..n-1 (vec2, one per set) and _KILN_WEIGHTS (vec4, normalised). Pass all of them on as
// ordinary (perspective-correct) varyings. `kiln_sets` and `kiln_blend` stand in the KILN_uv_sets extension object of the
// material (and in extras.kiln): sets 1..4; blend 0 "linear", 1 "variance", 2 "none"; `sharpness` and `size` are its
// sharpness and exemplarSize. `mean` is the extension's mean of the map that is sampled. Sample colour maps as sRGB textures, so that blending happens in linear light.

struct KilnSets {
    vec2 uv[4];
    vec4 weights;
    int sets;
    int blend;
    float sharpness;
    vec2 size;
};

// The weights that are applied: all of them, sharpened, or the greatest alone.
vec4 kiln_weights(KilnSets s) {
    vec4 w = pow(max(s.weights, vec4(0.0)), vec4(s.sharpness));
    w /= max(dot(w, vec4(1.0)), 1e-6);
    if (s.blend != 2) return w;
    float top = max(max(w.x, w.y), max(w.z, w.w));
    if (w.x == top) return vec4(1.0, 0.0, 0.0, 0.0);
    if (w.y == top) return vec4(0.0, 1.0, 0.0, 0.0);
    if (w.z == top) return vec4(0.0, 0.0, 1.0, 0.0);
    return vec4(0.0, 0.0, 0.0, 1.0);
}

// Texton bakes: leaves the blend out where the edge that it hides would be hardly visible (Magda, Kriegman 2003, Eq. 4).
// `edge` is the attribute _KILN_EDGE (vec2: mean difference of colours along the edge, length of the edge in world units;
// equal at all corners of a triangle), `lambda` the pixels across the view by its angle in radians, `distance` that of
// the fragment from the eye in world units, `threshold` what may stay visible, in pixels times difference (try 2).
KilnSets kiln_at_distance(KilnSets s, vec2 edge, float lambda, float distance, float threshold) {
    if (lambda * edge.x * edge.y <= threshold * distance) s.weights = vec4(1.0, 0.0, 0.0, 0.0);
    return s;
}

// Share of one sample's variance that a mean by these weights has: sets within two texels of each other are alike.
float kiln_variance(KilnSets s, vec4 w) {
    float v = dot(w, w);
    for (int i = 1; i < 4; ++i) {
        for (int j = 0; j < i; ++j) {
            if (i < s.sets) v += 2.0 * w[i] * w[j] * max(1.0 - length((s.uv[i] - s.uv[j]) * s.size) / 2.0, 0.0);
        }
    }
    return max(v, 1e-6);
}

// One map, blended. Gradients are taken before any branch.
vec4 kiln_sample(sampler2D map, KilnSets s, vec4 mean) {
    vec4 w = kiln_weights(s);
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        if (i < s.sets) sum += w[i] * texture(map, s.uv[i]);
    }
    if (s.blend == 1) sum = mean + (sum - mean) * inversesqrt(kiln_variance(s, w));
    return sum;
}

// Material-space bakes have two primitives for each of the input's: `sets` is 1 for the material of one (nearly all of it) and
// 3 for that of the other.
// Material-space bakes: the file that the extension names as `tile` holds the layers, as a 3D texture or (analysis.tile =
// "2d-array") a 2D array; wrap in s and t (REPEAT), clamp along m. `m` is the attribute _KILN_MATERIAL (float, passed on),
// `layers` the extension's (in GLSL ES also: precision highp sampler3D, sampler2DArray). In place of kiln_sample; the weights are linear, one set nearly everywhere.
vec4 kiln_layer(sampler3D tile, vec2 uv, float m, float layers) {
    return texture(tile, vec3(uv, (clamp(m, 0.0, 1.0) * (layers - 1.0) + 0.5) / layers));
}
vec4 kiln_layer(sampler2DArray tile, vec2 uv, float m, float layers) {
    float z = clamp(m, 0.0, 1.0) * (layers - 1.0);
    float below = floor(z);
    vec4 a = texture(tile, vec3(uv, below)), b = texture(tile, vec3(uv, min(below + 1.0, layers - 1.0)));
    return mix(a, b, z - below);
}
vec4 kiln_sample_tile(sampler3D tile, KilnSets s, float m, float layers) {
    vec4 w = kiln_weights(s), sum = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        vec4 v = kiln_layer(tile, s.uv[i], m, layers);
        if (i < s.sets) sum += w[i] * v;
    }
    return sum;
}
vec4 kiln_sample_tile(sampler2DArray tile, KilnSets s, float m, float layers) {
    vec4 w = kiln_weights(s), sum = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        vec4 v = kiln_layer(tile, s.uv[i], m, layers);
        if (i < s.sets) sum += w[i] * v;
    }
    return sum;
}

// A normal of the sample turned into the world: the frame is that of the gradients of its coordinates.
vec3 kiln_turned(vec3 m, vec2 uv, vec3 n, vec3 position) {
    vec3 px = dFdx(position), py = dFdy(position);
    vec2 ux = dFdx(uv), uy = dFdy(uv);
    // Direction in which u grows and, as v points down, against which v grows.
    float turn = sign(ux.x * uy.y - uy.x * ux.y);
    vec3 t = (px * uy.y - py * ux.y) * turn;
    vec3 b = (px * uy.x - py * ux.x) * turn;
    t = t - n * dot(n, t);
    b = b - n * dot(n, b);
    t *= inversesqrt(max(dot(t, t), 1e-20));
    b *= inversesqrt(max(dot(b, b), 1e-20));
    return t * m.x + b * m.y + n * m.z;
}

// World-space normal from the normal map's tile.
vec3 kiln_normal_tile(sampler3D tile, KilnSets s, float m, float layers, vec3 normal, vec3 position) {
    vec4 w = kiln_weights(s);
    vec3 n = normalize(normal), sum = vec3(0.0);
    for (int i = 0; i < 4; ++i) {
        vec3 v = kiln_turned(kiln_layer(tile, s.uv[i], m, layers).xyz * 2.0 - 1.0, s.uv[i], n, position);
        if (i < s.sets) sum += w[i] * v;
    }
    return normalize(sum);
}
vec3 kiln_normal_tile(sampler2DArray tile, KilnSets s, float m, float layers, vec3 normal, vec3 position) {
    vec4 w = kiln_weights(s);
    vec3 n = normalize(normal), sum = vec3(0.0);
    for (int i = 0; i < 4; ++i) {
        vec3 v = kiln_turned(kiln_layer(tile, s.uv[i], m, layers).xyz * 2.0 - 1.0, s.uv[i], n, position);
        if (i < s.sets) sum += w[i] * v;
    }
    return normalize(sum);
}

// World-space normal from the sample's normal map. Each set has its own frame, from the gradients of its coordinates.
// `normal` is the interpolated vertex normal, `position` the world (or view) position of the fragment.
// Pass the normal as the mesh has it, also on back faces, and negate the result there (doubleSided materials).
vec3 kiln_normal(sampler2D map, KilnSets s, vec3 normal, vec3 position) {
    vec4 w = kiln_weights(s);
    vec3 n = normalize(normal);
    vec3 sum = vec3(0.0);
    for (int i = 0; i < 4; ++i) {
        vec3 v = kiln_turned(texture(map, s.uv[i]).xyz * 2.0 - 1.0, s.uv[i], n, position);
        if (i < s.sets) sum += w[i] * v;
    }
    return normalize(sum);
}
