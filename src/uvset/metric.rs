//! The blend metric: how visible it is where two textures meet along an edge.
//!
//! Source: \[MK03\] section 3.3.2, Eq. 3 and 4. The continuity error is "a Euclidean distance of color texture values along
//! the edge for the two adjacent textures". Read as the mean over samples a texel apart of the distance of the two colours
//! (or whatever channels the texture has), so that it does not grow with the edge, whose length Eq. 4 multiplies in.
//! Unaware of: faces, how the coordinates came about.

use crate::texture::{Texel, Texture, Wrap, texel};

/// Mean distance of what two textures show along an edge, given where its two ends lie in either.
pub fn continuity_error(texture: &Texture, one: [Texel; 2], other: [Texel; 2]) -> f32 {
    let length = |[a, b]: [Texel; 2]| ((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y)).sqrt();
    let n = length(one).max(length(other)).clamp(1.0, 4096.0).round() as u32;
    let channels = texture.channels() as usize;
    let (mut a, mut b) = (vec![0.0; channels], vec![0.0; channels]);
    let mut sum = 0.0f64;
    for i in 0..n {
        let t = (i as f32 + 0.5) / n as f32;
        let at = |[p, q]: [Texel; 2]| texel(p.x + (q.x - p.x) * t, p.y + (q.y - p.y) * t);
        texture.sample(at(one), Wrap::Clamp, &mut a);
        texture.sample(at(other), Wrap::Clamp, &mut b);
        let d2: f32 = a.iter().zip(&b).map(|(x, y)| (x - y) * (x - y)).sum();
        sum += f64::from(d2.sqrt());
    }
    (sum / f64::from(n)) as f32
}

/// Eq. 4: the continuity error times the edge's length in pixels, as seen from a distance. `lambda` is pixels across the
/// field of view by the field of view in radians; length and distance are in one unit, the distance above zero. The edge
/// is worth blending if the result exceeds the wanted quality.
pub fn visibility(lambda: f64, error: f32, length: f64, distance: f64) -> f64 {
    lambda * f64::from(error) * length / distance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_place_has_no_error_and_a_step_has_its_height() {
        let t = Texture::from_fn(16, 16, 2, |x, _, out| out.fill(if x < 8 { 0.0 } else { 0.5 }));
        let (dark, light) = ([texel(2.0, 3.0), texel(2.0, 9.0)], [texel(12.0, 3.0), texel(12.0, 9.0)]);
        assert_eq!(continuity_error(&t, dark, dark), 0.0);
        let step = 0.5f32 * std::f32::consts::SQRT_2;
        assert!((continuity_error(&t, dark, light) - step).abs() < 1e-6);
        assert_eq!(continuity_error(&t, dark, light), continuity_error(&t, light, dark));
        // Half of the edge lies on the light side.
        let across = [texel(4.0, 3.0), texel(12.0, 3.0)];
        assert!((continuity_error(&t, across, [texel(2.0, 3.0), texel(2.0, 11.0)]) - step / 2.0).abs() < 0.05);
    }

    #[test]
    fn what_is_near_is_visible() {
        assert_eq!(visibility(800.0, 0.25, 2.0, 4.0), 100.0);
        assert_eq!(visibility(800.0, 0.25, 2.0, 8.0), 50.0);
    }
}
