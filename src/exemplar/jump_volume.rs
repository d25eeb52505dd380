//! The jump map of a flipbook: for every texel of every frame, a short list of texels with similar neighbourhoods.
//!
//! Source: \[ZG02\] section 2, carried over to time as section 6 proposes.
//! Unaware of: how the lists were found, files.

/// One jump: a destination texel, its frame, and the probability of taking it (\[ZG02\] Eq. 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct VolumeJump {
    to: [u16; 3],
    /// The probability in steps of 2^-16, less one.
    steps: u16,
}

impl VolumeJump {
    /// A jump to (x, y, frame) with probability `p`, rounded down to a multiple of 2^-16, at least one.
    pub fn new(to: [u16; 3], p: f64) -> Self {
        VolumeJump { to, steps: ((p * 65536.0).floor().clamp(1.0, 65536.0) - 1.0) as u16 }
    }

    /// Column, row and frame of the destination.
    pub fn to(&self) -> [u16; 3] {
        self.to
    }

    /// Probability, above 0, at most 1/k.
    pub fn p(&self) -> f64 {
        (f64::from(self.steps) + 1.0) / 65536.0
    }
}

/// For each texel of a flipbook its jumps, best first; the probabilities of a texel sum to at most 1 and what is missing
/// is the probability of no jump (\[ZG02\] Eq. 2). At k = 3 it takes 28 bytes per texel.
#[derive(Clone, Debug, PartialEq)]
pub struct JumpVolume {
    size: [u32; 3],
    starts: Vec<u32>,
    jumps: Vec<VolumeJump>,
}

impl JumpVolume {
    /// Builds from the number of jumps of each texel, frame by frame and row by row, and all jumps in that order.
    /// `None` if they do not fit each other or the size (width, height, frames), or a jump leads out of it.
    pub fn new(size: [u32; 3], counts: &[u8], jumps: Vec<VolumeJump>) -> Option<Self> {
        let texels: u128 = size.iter().map(|s| u128::from(*s)).product();
        let inside = |j: &VolumeJump| (0..3).all(|i| u32::from(j.to[i]) < size[i]);
        if counts.len() as u128 != texels || !jumps.iter().all(inside) {
            return None;
        }
        let mut starts = Vec::with_capacity(counts.len() + 1);
        let mut next = 0u32;
        starts.push(next);
        for count in counts {
            next = next.checked_add(u32::from(*count))?;
            starts.push(next);
        }
        (next as usize == jumps.len()).then_some(JumpVolume { size, starts, jumps })
    }

    /// Width, height, frames of the exemplar.
    pub fn size(&self) -> [u32; 3] {
        self.size
    }

    /// The number of jumps of each texel and all jumps, as [`JumpVolume::new`] takes them.
    pub fn parts(&self) -> (Vec<u8>, &[VolumeJump]) {
        (self.starts.windows(2).map(|w| (w[1] - w[0]) as u8).collect(), &self.jumps)
    }

    /// Jumps of a texel (x, y, frame), best first. Panics outside.
    #[inline]
    pub fn row(&self, [x, y, t]: [u16; 3]) -> &[VolumeJump] {
        let [w, h, _] = self.size.map(|s| s as usize);
        debug_assert!(usize::from(x) < w && usize::from(y) < h, "({x}, {y}) of {w} x {h}");
        let i = (usize::from(t) * h + usize::from(y)) * w + usize::from(x);
        &self.jumps[self.starts[i] as usize..self.starts[i + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_found_and_parts_fit() {
        let jumps = vec![VolumeJump::new([1, 0, 2], 0.25), VolumeJump::new([0, 0, 0], 0.0)];
        let counts = [0, 1, 0, 0, 0, 1];
        let map = JumpVolume::new([2, 1, 3], &counts, jumps.clone()).unwrap();
        assert_eq!(
            (map.row([1, 0, 0]), map.row([1, 0, 2]), map.row([0, 0, 1])),
            (&jumps[..1], &jumps[1..], &jumps[..0])
        );
        assert_eq!((jumps[0].p(), jumps[1].p()), (0.25, 1.0 / 65536.0));
        assert_eq!(map.parts(), (counts.to_vec(), &jumps[..]));
        assert_eq!(JumpVolume::new([2, 1, 2], &counts[..4], jumps.clone()), None, "a jump out of it");
        assert_eq!(JumpVolume::new([2, 1, 3], &[0; 6], jumps.clone()), None);
        assert_eq!(JumpVolume::new([2, 1, 3], &counts[1..], jumps), None);
    }
}
