//! Samples as they stand in a file, before or after any meaning is given to them.

/// Samples of an image as they go into a file: already quantised, so that what is hashed is what is written.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// 0..=255.
    U8(Vec<u8>),
    /// 0..=65535.
    U16(Vec<u16>),
    /// Linear float.
    F32(Vec<f32>),
}

/// What one sample is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SampleType {
    /// 8 bits, unsigned.
    U8,
    /// 16 bits, unsigned.
    U16,
    /// 32-bit float.
    F32,
}

impl SampleType {
    /// Bytes per sample.
    pub fn bytes(self) -> u64 {
        match self {
            SampleType::U8 => 1,
            SampleType::U16 => 2,
            SampleType::F32 => 4,
        }
    }

    /// `u8`, `u16` or `f32`.
    pub fn name(self) -> &'static str {
        match self {
            SampleType::U8 => "u8",
            SampleType::U16 => "u16",
            SampleType::F32 => "f32",
        }
    }
}

impl Samples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        match self {
            Samples::U8(v) => v.len(),
            Samples::U16(v) => v.len(),
            Samples::F32(v) => v.len(),
        }
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What one sample is.
    pub fn sample_type(&self) -> SampleType {
        match self {
            Samples::U8(_) => SampleType::U8,
            Samples::U16(_) => SampleType::U16,
            Samples::F32(_) => SampleType::F32,
        }
    }
}

/// An image ready to be encoded: row by row from the top, channels interleaved.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Texels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha.
    pub channels: u32,
    /// `width * height * channels` samples.
    pub samples: Samples,
}

impl Pixels {
    /// True if the fields agree: sides of at least 1, 1..=4 channels, as many samples as they say.
    pub fn is_whole(&self) -> bool {
        let texels = u64::from(self.width) * u64::from(self.height);
        (1..=4).contains(&self.channels)
            && texels > 0
            && texels.checked_mul(u64::from(self.channels)) == Some(self.samples.len() as u64)
    }

    /// True for 2 and 4 channels: the last one is alpha.
    pub fn has_alpha(&self) -> bool {
        self.channels.is_multiple_of(2)
    }

    /// Turned or mirrored upright: `orientation` is that of EXIF, 1..=8 (anything else: as it is).
    pub(crate) fn upright(self, orientation: u8) -> Pixels {
        if !(2..=8).contains(&orientation) {
            return self;
        }
        let (w, h, c) = (self.width as usize, self.height as usize, self.channels as usize);
        let samples = match &self.samples {
            Samples::U8(v) => Samples::U8(reordered(v, w, h, c, orientation)),
            Samples::U16(v) => Samples::U16(reordered(v, w, h, c, orientation)),
            Samples::F32(v) => Samples::F32(reordered(v, w, h, c, orientation)),
        };
        let (width, height) = if orientation >= 5 { (self.height, self.width) } else { (self.width, self.height) };
        Pixels { width, height, channels: self.channels, samples }
    }
}

/// Source: EXIF 2.32, tag 0x0112: where row 0 and column 0 of the stored image belong.
fn reordered<T: Copy>(from: &[T], w: usize, h: usize, c: usize, orientation: u8) -> Vec<T> {
    let (out_w, out_h) = if orientation >= 5 { (h, w) } else { (w, h) };
    let mut to = Vec::with_capacity(from.len());
    for y in 0..out_h {
        for x in 0..out_w {
            let (sx, sy) = match orientation {
                2 => (w - 1 - x, y),
                3 => (w - 1 - x, h - 1 - y),
                4 => (x, h - 1 - y),
                5 => (y, x),
                6 => (y, h - 1 - x),
                7 => (w - 1 - y, h - 1 - x),
                _ => (w - 1 - y, x),
            };
            let at = (sy * w + sx) * c;
            to.extend_from_slice(&from[at..at + c]);
        }
    }
    to
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_orientation_comes_out_as_the_exif_table_says() {
        // 1 2 3
        // 4 5 6
        let stored = Pixels { width: 3, height: 2, channels: 1, samples: Samples::U8(vec![1, 2, 3, 4, 5, 6]) };
        let expected: [(u8, u32, [u8; 6]); 9] = [
            (0, 3, [1, 2, 3, 4, 5, 6]),
            (1, 3, [1, 2, 3, 4, 5, 6]),
            (2, 3, [3, 2, 1, 6, 5, 4]),
            (3, 3, [6, 5, 4, 3, 2, 1]),
            (4, 3, [4, 5, 6, 1, 2, 3]),
            (5, 2, [1, 4, 2, 5, 3, 6]),
            (6, 2, [4, 1, 5, 2, 6, 3]),
            (7, 2, [6, 3, 5, 2, 4, 1]),
            (8, 2, [3, 6, 2, 5, 1, 4]),
        ];
        for (orientation, width, samples) in expected {
            let upright = stored.clone().upright(orientation);
            assert_eq!((upright.width, upright.height), (width, 6 / width));
            assert_eq!(upright.samples, Samples::U8(samples.to_vec()), "orientation {orientation}");
        }
    }

    #[test]
    fn pixels_whose_fields_disagree_are_not_whole() {
        let image = |width, height, channels, n| Pixels { width, height, channels, samples: Samples::U8(vec![0; n]) };
        assert!(image(2, 3, 4, 24).is_whole());
        assert!(!image(2, 3, 4, 23).is_whole());
        assert!(!image(2, 3, 5, 30).is_whole());
        assert!(!image(0, 3, 1, 0).is_whole());
        assert!(!image(u32::MAX, u32::MAX, 4, 0).is_whole());
    }
}
