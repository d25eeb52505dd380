//! Lighting of one point: a key light over the viewer's left shoulder, and a sky.
//!
//! Diffuse by Lambert, gloss by the GGX distribution with Schlick's Fresnel term and the Smith-Schlick visibility
//! (Karis 2013); the sky's reflection uses his fit of the environment term. Colours are linear.

use crate::numerics::det;

use super::look::Appearance;

type V3 = [f32; 3];

fn dot(a: V3, b: V3) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: V3) -> V3 {
    let l = dot(a, a).sqrt();
    if l > 0.0 { a.map(|x| x / l) } else { [0.0, 0.0, 1.0] }
}

/// Radiance of the key light, over pi.
const KEY: f32 = 0.95;
/// The sky straight up, at the horizon, and the ground.
const ZENITH: V3 = [0.52, 0.56, 0.62];
const HORIZON: V3 = [0.40, 0.40, 0.40];
const GROUND: V3 = [0.16, 0.15, 0.14];

/// Light from a direction of the world, blurred by `roughness`.
fn sky(direction: V3, roughness: f32) -> V3 {
    let edge = 0.08 + 0.92 * roughness;
    let t = (direction[1] / edge).clamp(-1.0, 1.0);
    std::array::from_fn(|k| {
        let far = if t > 0.0 { ZENITH[k] } else { GROUND[k] };
        HORIZON[k] + (far - HORIZON[k]) * t.abs()
    })
}

/// Directions that lighting needs, unit vectors in the world.
#[derive(Clone, Copy)]
pub(super) struct Directions {
    /// From the point to the eye.
    pub eye: V3,
    /// From the point to the key light.
    pub key: V3,
}

/// Linear colour of a lit point.
pub(super) fn lit(a: &Appearance, to: Directions) -> V3 {
    let n = unit(a.normal);
    let nv = dot(n, to.eye).max(1e-3);
    let nl = dot(n, to.key).max(0.0);
    let h = unit([to.eye[0] + to.key[0], to.eye[1] + to.key[1], to.eye[2] + to.key[2]]);
    let (nh, vh) = (dot(n, h).max(0.0), dot(to.eye, h).max(0.0));
    let rough = a.roughness.clamp(0.05, 1.0);
    let alpha2 = rough * rough * rough * rough;
    let d = nh * nh * (alpha2 - 1.0) + 1.0;
    let k = (rough + 1.0) * (rough + 1.0) / 8.0;
    let visibility = 0.25 / ((nl * (1.0 - k) + k) * (nv * (1.0 - k) + k));
    let gloss = alpha2 / (d * d) * visibility * nl * KEY;
    let schlick = (1.0 - vh) * (1.0 - vh) * (1.0 - vh) * (1.0 - vh) * (1.0 - vh);
    let mirror = std::array::from_fn(|i| 2.0 * dot(n, to.eye) * n[i] - to.eye[i]);
    let (around, reflected) = (sky(n, 1.0), sky(mirror, rough));
    // The share of the sky that a surface of this roughness reflects, as factor and offset on its colour.
    let r = [1.0 - rough, 0.0425 - 0.0275 * rough, 1.04 - 0.572 * rough, 0.022 * rough - 0.04];
    let fresnel = (r[0] * r[0]).min(det::expf(-9.28 * std::f32::consts::LN_2 * nv)) * r[0] + r[1];
    let (scale, offset) = (-1.04 * fresnel + r[2], 1.04 * fresnel + r[3]);
    std::array::from_fn(|i| {
        let diffuse = a.color[i] * (1.0 - a.metallic);
        let f0 = 0.04 + (a.color[i] - 0.04) * a.metallic;
        let from_sky = diffuse * around[i] + reflected[i] * (f0 * scale + offset).max(0.0);
        diffuse * nl * KEY + gloss * (f0 + (1.0 - f0) * schlick) + from_sky * a.occlusion + a.emissive[i]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(normal: V3) -> Appearance {
        Appearance { color: [0.5; 3], normal, roughness: 0.8, ..Appearance::default() }
    }

    #[test]
    fn what_faces_the_key_light_is_brighter_and_nothing_is_nan() {
        let to = Directions { eye: [0.0, 0.0, 1.0], key: unit([-0.5, 0.7, 0.6]) };
        let facing = lit(&plain(to.key), to)[1];
        let away = lit(&plain([0.5, -0.7, 0.4]), to)[1];
        assert!(facing > 2.0 * away, "{facing} {away}");
        assert!(lit(&plain([0.0; 3]), to).iter().all(|v| v.is_finite()));
        let mirror = Appearance { metallic: 1.0, roughness: 0.0, ..plain(unit([-0.25, 0.35, 0.8])) };
        assert!(lit(&mirror, to).iter().all(|v| v.is_finite() && *v > 0.0));
    }
}
