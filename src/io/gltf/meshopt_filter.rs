//! Filters of KHR_meshopt_compression: what turns decoded bytes into vectors, rotations, floats and colours.
//!
//! Source: KHR_meshopt_compression, appendix B. Unaware of: the bitstreams (see `meshopt`).

/// Names as they stand in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Filter {
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

impl Filter {
    /// Whether elements may have this many bytes.
    pub(super) fn allows(self, stride: usize) -> bool {
        match self {
            Filter::Octahedral | Filter::Color => stride == 4 || stride == 8,
            Filter::Quaternion => stride == 8,
            Filter::Exponential => stride.is_multiple_of(4),
        }
    }

    /// Decodes all elements in place.
    pub(super) fn apply(self, bytes: &mut [u8], stride: usize) {
        for element in bytes.chunks_exact_mut(stride) {
            match self {
                Filter::Exponential => element.chunks_exact_mut(4).for_each(exponential),
                Filter::Octahedral => edit(element, true, octahedral),
                Filter::Quaternion => edit(element, true, |v, _| quaternion(v)),
                Filter::Color => edit(element, false, color),
            }
        }
    }
}

/// Runs `f(components, greatest value)` over four integers of 8 or 16 bits.
fn edit(element: &mut [u8], signed: bool, f: impl Fn([i32; 4], f32) -> [i32; 4]) {
    if element.len() == 4 {
        let v = std::array::from_fn(|i| if signed { i32::from(element[i] as i8) } else { i32::from(element[i]) });
        let out = f(v, if signed { 127.0 } else { 255.0 });
        element.iter_mut().zip(out).for_each(|(e, o)| *e = o as u8);
    } else {
        let v = std::array::from_fn(|i| {
            let u = u16::from_le_bytes([element[2 * i], element[2 * i + 1]]);
            if signed { i32::from(u as i16) } else { i32::from(u) }
        });
        let out = f(v, if signed { 32767.0 } else { 65535.0 });
        element.chunks_exact_mut(2).zip(out).for_each(|(e, o)| e.copy_from_slice(&(o as u16).to_le_bytes()));
    }
}

/// Unit vectors: x and y on the octahedron, z holds the integer that stands for one, w passes through.
fn octahedral(v: [i32; 4], max: f32) -> [i32; 4] {
    let (x, y, one) = (v[0] as f32, v[1] as f32, v[2] as f32);
    let z = one - x.abs() - y.abs();
    let t = z.min(0.0);
    let (x, y) = (if x >= 0.0 { x + t } else { x - t }, if y >= 0.0 { y + t } else { y - t });
    let scale = max / (x * x + y * y + z * z).sqrt();
    [(x * scale).round() as i32, (y * scale).round() as i32, (z * scale).round() as i32, v[3]]
}

/// Rotations: three components, and in the fourth the integer of one with the place of the greatest in its low bits.
fn quaternion(v: [i32; 4]) -> [i32; 4] {
    let scale = std::f32::consts::FRAC_1_SQRT_2 / (v[3] | 3) as f32;
    let [x, y, z] = [v[0] as f32 * scale, v[1] as f32 * scale, v[2] as f32 * scale];
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let greatest = (v[3] & 3) as usize;
    let mut out = [0; 4];
    for (i, c) in [w, x, y, z].into_iter().enumerate() {
        out[(greatest + i) % 4] = (c * 32767.0).round() as i32;
    }
    out
}

/// Floats: a signed exponent of 8 bits over a signed mantissa of 24.
fn exponential(word: &mut [u8]) {
    let v = i32::from_le_bytes([word[0], word[1], word[2], word[3]]);
    let (exponent, mantissa) = (v >> 24, (v << 8) >> 8);
    // 2^exponent is an exact f64, and so is the product.
    let power = f64::from_bits(((exponent + 1023) as u64) << 52);
    word.copy_from_slice(&((f64::from(mantissa) * power) as f32).to_le_bytes());
}

/// Colours: luma, two chromas, and alpha whose highest bit tells the number of bits.
fn color(v: [i32; 4], max: f32) -> [i32; 4] {
    let signed = |c: i32| if max == 255.0 { i32::from(c as u8 as i8) } else { i32::from(c as u16 as i16) };
    let (y, co, cg) = (v[0], signed(v[1]), signed(v[2]));
    let bits = 32 - v[3].leading_zeros();
    let one = ((1u32 << bits) - 1) as i32;
    let a = v[3] & (one >> 1);
    let scale = if one > 0 { max / one as f32 } else { 0.0 };
    [y + co - cg, y + cg, y - co - cg, a << 1 | a & 1].map(|c| (c as f32 * scale).round().clamp(0.0, max) as i32)
}

#[cfg(test)]
mod tests {
    use super::super::meshopt::{attributes, tests::hex};
    use super::*;

    fn decode(code: &str, count: usize, stride: usize, filter: Filter) -> Vec<u8> {
        let mut out = attributes(&hex(code), count, stride).unwrap();
        assert!(filter.allows(stride));
        filter.apply(&mut out, stride);
        out
    }

    fn words(bytes: &[u8]) -> Vec<i16> {
        bytes.chunks(2).map(|b| i16::from_le_bytes([b[0], b[1]])).collect()
    }

    /// Streams of meshoptimizer 1.3.
    #[test]
    fn unit_vectors_and_rotations() {
        let code = "a1ef006cee0091b50004030000000000000000000000000000000000000000007f7f00";
        let bytes: Vec<i8> = decode(code, 3, 4, Filter::Octahedral).iter().map(|&b| b as i8).collect();
        assert_eq!(bytes, [0, 0, 127, 127, 76, -102, 0, -127, -60, 76, -82, 127]);
        let code = "a1ffba00dabc00061100dcac000914000403000000000000000000000000000000000000ff07ff7f0001";
        let v = words(&decode(code, 3, 8, Filter::Octahedral));
        for (found, wanted) in v.chunks(4).zip([[0., 0., 1., 1.], [0.6, -0.8, 0., -1.], [-0.48, 0.6, -0.64, 1.]]) {
            assert!(found.iter().zip(wanted).all(|(f, w)| (f64::from(*f) / 32767.0 - w).abs() < 2e-3), "{found:?}");
        }
        let code = "a1ffbf00b26f000b0e00b1c7000a0500b115000a110005060000000000000000000000000000000000000000ff070000";
        let v = words(&decode(code, 3, 8, Filter::Quaternion));
        for (found, wanted) in v.chunks(4).zip([[0., 0., 0., 1.], [0.5, -0.5, 0.5, 0.5], [0.1, 0.2, -0.3, 0.927]]) {
            let near =
                |sign: f64| found.iter().zip(wanted).all(|(f, w)| (sign * f64::from(*f) / 32767.0 - w).abs() < 1e-3);
            assert!(near(1.0) || near(-1.0), "{found:?}");
        }
    }

    #[test]
    fn floats_are_exact_and_colours_close() {
        let code = "a1ff00e47100a3a400010200274200000000000000000000000000000000000000003000f300";
        assert_eq!(decode(code, 3, 4, Filter::Exponential), hex("0000c03f003886b500e44046"));
        let code = "a1ff0079005c0021007d00000000000000000000000000000000000000905ff1ff00";
        assert_eq!(decode(code, 2, 4, Filter::Color), hex("fe8140ff0033e680"));
        // Exponents beyond those allowed give an infinity or zero, no panic.
        let mut wild = [0xff, 0xff, 0x7f, 0x7f, 1, 0, 0, 0x80];
        Filter::Exponential.apply(&mut wild, 8);
        for element in [[0u8; 8], [0xff; 8], [0x80; 8]] {
            for filter in [Filter::Octahedral, Filter::Quaternion, Filter::Exponential, Filter::Color] {
                filter.apply(&mut element.clone(), 8);
            }
        }
    }
}
