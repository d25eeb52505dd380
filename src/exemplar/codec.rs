//! The jump map as bytes, for the cache.
//!
//! Layout: "KJM1", width, height, number of jumps (u32, little endian), checksum (u64, FNV-1a of the LZ4 block), LZ4
//! block of: jumps per texel (u8 each), then byte planes over all jumps: low and high bytes of the horizontal offset from
//! the texel, of the vertical offset (both modulo 65536) and of the probability times 65536 less one. Measured
//! at k = 3: 7 bytes per texel for a checkerboard, 12.7 to 13.7 for photographs, of 19 before LZ4.
//! Probabilities off the grid of 2^-16 are rounded down onto it; `analyse` makes none.
//! Unaware of: files, the cache.

use super::{Error, Jump, JumpMap};

const MAGIC: &[u8; 4] = b"KJM1";
const HEADER: usize = 24;
const STEPS: f32 = 65536.0;
/// An LZ4 block cannot hold more than this many times its size.
const MAX_RATIO: u64 = 255;

impl JumpMap {
    /// The map in a compact form that [`JumpMap::from_bytes`] reads.
    pub fn to_bytes(&self) -> Vec<u8> {
        let (counts, jumps) = self.parts();
        let mut planes: Vec<u8> = counts.collect();
        let mut words: [Vec<u16>; 3] = std::array::from_fn(|_| Vec::with_capacity(jumps.len()));
        for y in 0..self.height() {
            for x in 0..self.width() {
                for j in self.row(x, y) {
                    words[0].push(j.x.wrapping_sub(x as u16));
                    words[1].push(j.y.wrapping_sub(y as u16));
                    words[2].push(((j.p * STEPS).floor().clamp(1.0, STEPS) - 1.0) as u16);
                }
            }
        }
        for word in words {
            planes.extend(word.iter().map(|w| w.to_le_bytes()[0]));
            planes.extend(word.iter().map(|w| w.to_le_bytes()[1]));
        }
        let packed = lz4_flex::block::compress(&planes);
        let mut out = Vec::with_capacity(HEADER + packed.len());
        out.extend_from_slice(MAGIC);
        for n in [self.width(), self.height(), jumps.len() as u32] {
            out.extend_from_slice(&n.to_le_bytes());
        }
        out.extend_from_slice(&checksum(&packed).to_le_bytes());
        out.extend_from_slice(&packed);
        out
    }

    /// Reads what [`JumpMap::to_bytes`] wrote. Anything else, or a damaged map, is [`Error::Damaged`].
    pub fn from_bytes(bytes: &[u8]) -> Result<JumpMap, Error> {
        let (header, packed) = bytes.split_at_checked(HEADER).ok_or(Error::Damaged("too short for a header"))?;
        if &header[..4] != MAGIC {
            return Err(Error::Damaged("no KJM1 mark"));
        }
        let word = |i: usize| u32::from_le_bytes([header[i], header[i + 1], header[i + 2], header[i + 3]]);
        let (width, height, count) = (word(4), word(8), word(12) as usize);
        if (u64::from(word(20)) << 32) | u64::from(word(16)) != checksum(packed) {
            return Err(Error::Damaged("the checksum differs"));
        }
        if width == 0 || height == 0 || width > 65535 || height > 65535 {
            return Err(Error::Damaged("a side is 0 or above 65535"));
        }
        let texels = u64::from(width) * u64::from(height);
        let size = texels + 6 * count as u64;
        if size > MAX_RATIO * packed.len() as u64 {
            return Err(Error::Damaged("too short for its size"));
        }
        let planes = lz4_flex::block::decompress(packed, size as usize)
            .ok()
            .filter(|p| p.len() as u64 == size)
            .ok_or(Error::Damaged("the LZ4 block does not unpack to its size"))?;
        let (counts, planes) = planes.split_at(texels as usize);
        if counts.iter().map(|c| usize::from(*c)).sum::<usize>() != count {
            return Err(Error::Damaged("the jumps do not add up"));
        }
        rows(width, height, counts, planes, count).map(|rows| JumpMap::from_rows(width, height, &rows))
    }
}

/// The rows from the jumps per texel and the planes.
fn rows(width: u32, height: u32, counts: &[u8], planes: &[u8], total: usize) -> Result<Vec<Vec<Jump>>, Error> {
    let word = |plane: usize, i: usize| {
        u16::from_le_bytes([planes[2 * plane * total + i], planes[(2 * plane + 1) * total + i]])
    };
    let mut next = 0;
    let mut out = Vec::with_capacity(counts.len());
    for (texel, &count) in counts.iter().enumerate() {
        let (x, y) = ((texel as u32 % width) as u16, (texel as u32 / width) as u16);
        let jump = |i| Jump {
            x: x.wrapping_add(word(0, i)),
            y: y.wrapping_add(word(1, i)),
            p: (f32::from(word(2, i)) + 1.0) / STEPS,
        };
        let row: Vec<Jump> = (next..next + usize::from(count)).map(jump).collect();
        if row.iter().any(|j| u32::from(j.x) >= width || u32::from(j.y) >= height) {
            return Err(Error::Damaged("a jump leads out of the exemplar"));
        }
        next += usize::from(count);
        out.push(row);
    }
    Ok(out)
}

/// FNV-1a.
fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn small() -> JumpMap {
        let mut rows = vec![vec![]; 6];
        rows[0] = vec![Jump { x: 2, y: 1, p: 0.5 }, Jump { x: 1, y: 0, p: 1.0 / 65536.0 }];
        rows[5] = vec![Jump { x: 0, y: 0, p: 1.0 }];
        JumpMap::from_rows(3, 2, &rows)
    }

    #[test]
    fn survives_the_round_trip() {
        let map = small();
        assert_eq!(JumpMap::from_bytes(&map.to_bytes()), Ok(map));
        let empty = JumpMap::from_rows(2, 2, &vec![vec![]; 4]);
        assert_eq!(JumpMap::from_bytes(&empty.to_bytes()), Ok(empty));
    }

    #[test]
    fn probabilities_off_the_grid_are_rounded_down() {
        let map = JumpMap::from_rows(1, 1, &[vec![Jump { x: 0, y: 0, p: 0.4 }]]);
        let p = JumpMap::from_bytes(&map.to_bytes()).unwrap().row(0, 0)[0].p;
        assert_eq!(p, 26214.0 / 65536.0);
    }

    /// `small` with another header field or block, under a right checksum.
    fn forged(field: usize, value: u32, packed: Option<Vec<u8>>) -> Vec<u8> {
        let mut bytes = small().to_bytes();
        bytes[field..field + 4].copy_from_slice(&value.to_le_bytes());
        if let Some(packed) = packed {
            bytes.truncate(HEADER);
            bytes.extend_from_slice(&packed);
            bytes[16..24].copy_from_slice(&checksum(&packed).to_le_bytes());
        }
        bytes
    }

    #[test]
    fn damage_is_named() {
        let fault = |bytes: &[u8]| match JumpMap::from_bytes(bytes) {
            Err(Error::Damaged(what)) => what,
            other => panic!("{other:?}"),
        };
        assert_eq!(fault(&[]), "too short for a header");
        assert_eq!(fault(&[0; 40]), "no KJM1 mark");
        assert_eq!(fault(&forged(4, 0, None)), "a side is 0 or above 65535");
        assert_eq!(fault(&forged(4, 65535, None)), "too short for its size");
        assert_eq!(fault(&forged(12, u32::MAX, None)), "too short for its size");
        assert_eq!(fault(&forged(12, 4, None)), "the LZ4 block does not unpack to its size");
        let block = |counts: [u8; 6], x: u8| {
            let mut planes = counts.to_vec();
            planes.extend([x, 0, 0, 0, 0, 0]);
            lz4_flex::block::compress(&planes)
        };
        assert_eq!(fault(&forged(12, 1, Some(block([0, 0, 0, 0, 0, 9], 0)))), "the jumps do not add up");
        assert_eq!(fault(&forged(12, 1, Some(block([1, 0, 0, 0, 0, 0], 3)))), "a jump leads out of the exemplar");
        assert!(JumpMap::from_bytes(&forged(12, 1, Some(block([1, 0, 0, 0, 0, 0], 2)))).is_ok());
    }

    proptest! {
        #[test]
        fn any_changed_byte_of_the_block_is_noticed(at in 16usize..40, with in 1u8..) {
            let mut bytes = small().to_bytes();
            let at = at % bytes.len().max(1);
            prop_assume!(at >= 16);
            bytes[at] ^= with;
            prop_assert!(JumpMap::from_bytes(&bytes).is_err());
        }

        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200), forge in any::<bool>()) {
            let bytes = if forge { forged(12, 3, Some(bytes)) } else { bytes };
            let _ = JumpMap::from_bytes(&bytes);
        }
    }
}
