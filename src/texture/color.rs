//! Transfer functions and luminance.

use crate::numerics::det;

/// sRGB (0..1) to linear light (IEC 61966-2-1).
pub fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.040_45 { v / 12.92 } else { det::powf((v + 0.055) / 1.055, 2.4) }
}

/// Linear light to sRGB (IEC 61966-2-1); values outside 0..1 are clamped.
pub fn linear_to_srgb(v: f32) -> f32 {
    let v = v.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * det::powf(v, 1.0 / 2.4) - 0.055 }
}

/// Relative luminance of linear Rec. 709 colour.
pub fn luminance(rgb: [f32; 3]) -> f32 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_bit_values_survive_the_round_trip() {
        for i in 0..=255u8 {
            let v = f32::from(i) / 255.0;
            assert_eq!((linear_to_srgb(srgb_to_linear(v)) * 255.0).round() as u8, i);
        }
    }
}
