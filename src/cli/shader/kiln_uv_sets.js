// kiln: reference consumer of UV sets for three.js (WebGLRenderer, MeshStandardMaterial).
//
//     import { applyKilnUvSets } from './kiln_uv_sets.js';
//     const gltf = await new GLTFLoader().loadAsync('name.uvsets.glb');
//     gltf.scene.traverse((o) => o.isMesh && applyKilnUvSets(o));
//
// GLTFLoader names the attributes uv, uv1, uv2, uv3 and _kiln_weights, and keeps the material's extras in userData.

// Material-space bakes name a tile, `mesh.material.userData.kiln.tile`; load it (KTX2Loader, or by hand) and pass it on, one
// texture per map: applyKilnUvSets(o, { map, normalMap, roughnessMap, metalnessMap, aoMap, emissiveMap }), each a
// Data3DTexture or an array texture that repeats in s and t. What is not passed shows the layer in the material. Such a bake has two
// meshes for each of the input's primitives, with materials of their own: `sets` is 1 for nearly all of it, and 3 for the rest.

export function applyKilnUvSets(mesh, tiles = {}) {
    const kiln = mesh.material.userData.kiln;
    if (!kiln || !mesh.geometry.attributes._kiln_weights) return;
    const sets = kiln.sets;
    const names = ['uv', 'uv1', 'uv2', 'uv3'].slice(0, sets);
    const mean = (map) => (kiln.means && kiln.means[map] ? kiln.means[map] : [0.5, 0.5, 0.5]);
    const vec4 = (m) => `vec4(${[0, 1, 2, 3].map((i) => (m[i] ?? (i == 3 ? 1 : m[0])).toFixed(6)).join(', ')})`;
    const blend = { linear: 0, variance: 1, none: 2 }[kiln.blend] ?? 0;
    const sharpness = kiln.sharpness ?? 1;
    const size = `vec2(${kiln.exemplarSize.map((s) => s.toFixed(1)).join(', ')})`;
    // Sets within two texels of each other are alike and lose no variance.
    const alike = (i, j) => `max(1.0 - length((vKilnUv${i} - vKilnUv${j}) * ${size}) / 2.0, 0.0)`;
    const pairs = names.flatMap((_, i) => names.slice(0, i).map((_, j) => `v += 2.0 * w[${i}] * w[${j}] * ${alike(i, j)};`)).join('\n');

    const layers = mesh.geometry.attributes._kiln_material && kiln.layers;
    const tiled = layers ? Object.keys(tiles) : [];
    const look = (map, mean) => (tiled.includes(map) ? `kilnTile_${map}()` : `kilnSample(${map}, ${mean})`);
    const lookUp = (map) => {
        const volume = tiles[map].isData3DTexture;
        const z = `clamp(vKilnMaterial, 0.0, 1.0) * ${(layers - 1).toFixed(1)}`;
        const of = (uv) => volume
            ? `texture(kilnTile_of_${map}, vec3(${uv}, (${z} + 0.5) / ${layers.toFixed(1)}))`
            : `mix(texture(kilnTile_of_${map}, vec3(${uv}, floor(${z}))),
                texture(kilnTile_of_${map}, vec3(${uv}, min(floor(${z}) + 1.0, ${(layers - 1).toFixed(1)}))), fract(${z}))`;
        return `uniform highp ${volume ? 'sampler3D' : 'sampler2DArray'} kilnTile_of_${map};
vec4 kilnTile_${map}(vec2 uv) { return ${of('uv')}; }
vec4 kilnTile_${map}() {
    vec4 w = kilnWeights(), sum = vec4(0.0);
    ${names.map((_, i) => `sum += w[${i}] * kilnTile_${map}(vKilnUv${i});`).join('\n    ')}
    return sum;
}`;
    };

    mesh.material.onBeforeCompile = (shader) => {
        for (const map of tiled) shader.uniforms[`kilnTile_of_${map}`] = { value: tiles[map] };
        const own = names.slice(1).map((n) => `#ifndef USE_${n.toUpperCase()}
attribute vec2 ${n};
#endif`);
        shader.vertexShader = shader.vertexShader
            .replace('#include <common>', `#include <common>
attribute vec4 _kiln_weights;
${layers ? 'attribute float _kiln_material;\nvarying float vKilnMaterial;' : ''}
${own.join('\n')}
varying vec4 vKilnWeights;
${names.map((_, i) => `varying vec2 vKilnUv${i};`).join('\n')}`)
            .replace('#include <uv_vertex>', `#include <uv_vertex>
vKilnWeights = _kiln_weights;
${layers ? 'vKilnMaterial = _kiln_material;' : ''}
${names.map((n, i) => `vKilnUv${i} = ${n};`).join('\n')}`);

        const each = (f) => names.map((_, i) => f(i)).join('\n');
        shader.fragmentShader = shader.fragmentShader
            .replace('#include <common>', `#include <common>
varying vec4 vKilnWeights;
${names.map((_, i) => `varying vec2 vKilnUv${i};`).join('\n')}
vec4 kilnWeights() {
    vec4 w = pow(max(vKilnWeights, vec4(0.0)), vec4(${sharpness.toFixed(1)}));
    w /= max(dot(w, vec4(1.0)), 1e-6);
    if (${blend} != 2) return w;
    float top = max(max(w.x, w.y), max(w.z, w.w));
    return w.x == top ? vec4(1, 0, 0, 0) : w.y == top ? vec4(0, 1, 0, 0) : w.z == top ? vec4(0, 0, 1, 0) : vec4(0, 0, 0, 1);
}
float kilnVariance(vec4 w) {
    float v = dot(w, w);
    ${pairs}
    return max(v, 1e-6);
}
vec4 kilnSample(sampler2D map, vec4 mean) {
    vec4 w = kilnWeights(), sum = vec4(0.0);
    ${each((i) => `sum += w[${i}] * texture2D(map, vKilnUv${i});`)}
    if (${blend} == 1) sum = mean + (sum - mean) * inversesqrt(kilnVariance(w));
    return sum;
}
${layers ? 'varying float vKilnMaterial;' : ''}
${tiled.map(lookUp).join('\n')}
vec3 kilnNormal(sampler2D map, vec3 n, vec3 position) {
    vec4 w = kilnWeights();
    vec3 px = dFdx(position), py = dFdy(position), sum = vec3(0.0);
    float side = 1.0;
#ifdef DOUBLE_SIDED
    side = gl_FrontFacing ? 1.0 : -1.0;
#endif
    ${each((i) => `{
        vec2 ux = dFdx(vKilnUv${i}), uy = dFdy(vKilnUv${i});
        float turn = sign(ux.x * uy.y - uy.x * ux.y);
        vec3 t = (px * uy.y - py * ux.y) * turn, b = (px * uy.x - py * ux.x) * turn;
        t -= n * dot(n, t);
        b -= n * dot(n, b);
        t *= inversesqrt(max(dot(t, t), 1e-20));
        b *= inversesqrt(max(dot(b, b), 1e-20));
        vec3 m = ${tiled.includes('normalMap') ? `kilnTile_normalMap(vKilnUv${i})` : `texture2D(map, vKilnUv${i})`}.xyz * 2.0 - 1.0;
        sum += w[${i}] * (side * (t * m.x + b * m.y) + n * m.z);
    }`)}
    return normalize(sum);
}`)
            .replace('#include <map_fragment>', `#ifdef USE_MAP
diffuseColor *= ${look('map', vec4(mean('base_color')))};
#endif`)
            .replace('#include <roughnessmap_fragment>', `float roughnessFactor = roughness;
#ifdef USE_ROUGHNESSMAP
roughnessFactor *= ${look('roughnessMap', vec4(mean('orm')))}.g;
#endif`)
            .replace('#include <metalnessmap_fragment>', `float metalnessFactor = metalness;
#ifdef USE_METALNESSMAP
metalnessFactor *= ${look('metalnessMap', vec4(mean('orm')))}.b;
#endif`)
            .replace('#include <normal_fragment_maps>', `#ifdef USE_NORMALMAP_TANGENTSPACE
normal = kilnNormal(normalMap, normal, -vViewPosition);
#endif`)
            .replace('#include <aomap_fragment>', `#ifdef USE_AOMAP
float ambientOcclusion = (${look('aoMap', vec4(mean('orm')))}.r - 1.0) * aoMapIntensity + 1.0;
reflectedLight.indirectDiffuse *= ambientOcclusion;
#if defined(USE_ENVMAP) && defined(STANDARD)
float dotNV = saturate(dot(geometryNormal, geometryViewDir));
reflectedLight.indirectSpecular *= computeSpecularOcclusion(dotNV, ambientOcclusion, material.roughness);
#endif
#endif`)
            .replace('#include <emissivemap_fragment>', `#ifdef USE_EMISSIVEMAP
totalEmissiveRadiance *= ${look('emissiveMap', vec4(mean('emissive')))}.rgb;
#endif`);
    };
    mesh.material.customProgramCacheKey = () => `kiln-${sets}-${blend}-${sharpness}-${size}-${layers}-${tiled}-${JSON.stringify(kiln.means ?? {})}`;
    mesh.material.needsUpdate = true;
}
