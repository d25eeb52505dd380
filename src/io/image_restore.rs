//! Puts the samples of a file back into an image that was made of it, where that must not change.
//!
//! Decoding gives meaning to samples (linear light, unit normals), and quantising them again does not always give back
//! the very same: a normal of 8 bits is never quite of unit length.
//! Unaware of: what the channels mean, but for alpha.

use super::{Pixels, Samples};

/// Copies the samples of `original` into `image`, which shows its rows from `first_row` on, where `keep` says so (one per
/// pixel of the original, row by row). Grey is copied to all channels, surplus channels are left out, alpha that the
/// original lacks is opaque. 8 bits widen to 16.
///
/// Does nothing if that would not be exact: if the sizes do not fit, the original has a wider type, or floats against
/// integers.
pub fn restore(image: &mut Pixels, original: &Pixels, keep: &[bool], first_row: u32) {
    let Pixels { width, height, .. } = *original;
    let fits = image.width == width && u64::from(first_row) + u64::from(image.height) <= u64::from(height);
    if !fits || keep.len() != width as usize * height as usize {
        return;
    }
    let begin = first_row as usize * width as usize;
    let keep = &keep[begin..];
    let from = Channels { image: image.channels as usize, original: original.channels as usize, begin };
    match (&mut image.samples, &original.samples) {
        (Samples::U8(to), Samples::U8(v)) => from.copy(to, v, keep, |v| v, u8::MAX),
        (Samples::U16(to), Samples::U16(v)) => from.copy(to, v, keep, |v| v, u16::MAX),
        (Samples::U16(to), Samples::U8(v)) => from.copy(to, v, keep, |v| u16::from(v) * 257, u16::MAX),
        (Samples::F32(to), Samples::F32(v)) => from.copy(to, v, keep, |v| v, 1.0),
        _ => {}
    }
}

/// Channels of both images.
struct Channels {
    image: usize,
    original: usize,
    /// First texel of the original that the image shows.
    begin: usize,
}

impl Channels {
    fn copy<T: Copy, F: Copy>(&self, to: &mut [T], from: &[F], keep: &[bool], widen: impl Fn(F) -> T, opaque: T) {
        // Of each channel, the one that it comes from.
        let alpha = (self.original.is_multiple_of(2)).then(|| self.original - 1);
        let source: Vec<Option<usize>> = (0..self.image)
            .map(|c| match c {
                _ if self.image.is_multiple_of(2) && c + 1 == self.image => alpha,
                _ if self.original < 3 => Some(0),
                _ => Some(c),
            })
            .collect();
        let texels = to.chunks_exact_mut(self.image).zip(from.chunks_exact(self.original).skip(self.begin)).zip(keep);
        for ((to, from), _) in texels.filter(|(_, keep)| **keep) {
            for (to, source) in to.iter_mut().zip(&source) {
                *to = source.map_or(opaque, |c| widen(from[c]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(channels: u32, samples: Samples) -> Pixels {
        Pixels { width: samples.len() as u32 / channels, height: 1, channels, samples }
    }

    #[test]
    fn channels_find_their_places() {
        let keep = [true, false];
        let put = |channels: u32, original: &Pixels| {
            let mut image = pixels(channels, Samples::U8(vec![9; 2 * channels as usize]));
            restore(&mut image, original, &keep, 0);
            image.samples
        };
        let rgba = pixels(4, Samples::U8(vec![1, 2, 3, 4, 5, 6, 7, 8]));
        assert_eq!(put(3, &rgba), Samples::U8(vec![1, 2, 3, 9, 9, 9]));
        assert_eq!(put(4, &rgba), Samples::U8(vec![1, 2, 3, 4, 9, 9, 9, 9]));
        assert_eq!(put(1, &rgba), Samples::U8(vec![1, 9]));
        let grey = pixels(1, Samples::U8(vec![1, 2]));
        assert_eq!(put(4, &grey), Samples::U8(vec![1, 1, 1, 255, 9, 9, 9, 9]));
        let grey_alpha = pixels(2, Samples::U8(vec![1, 2, 3, 4]));
        assert_eq!(put(4, &grey_alpha), Samples::U8(vec![1, 1, 1, 2, 9, 9, 9, 9]));
    }

    #[test]
    fn a_strip_finds_its_rows() {
        let original = Pixels { width: 1, height: 3, channels: 1, samples: Samples::U8(vec![1, 2, 3]) };
        let mut strip = Pixels { height: 2, samples: Samples::U8(vec![9; 2]), ..original };
        restore(&mut strip, &original, &[true, false, true], 1);
        assert_eq!(strip.samples, Samples::U8(vec![9, 3]));
        restore(&mut strip, &original, &[true; 3], 2);
        assert_eq!(strip.samples, Samples::U8(vec![9, 3]));
    }

    #[test]
    fn only_what_is_exact_is_done() {
        let mut wide = pixels(1, Samples::U16(vec![7, 7]));
        restore(&mut wide, &pixels(1, Samples::U8(vec![1, 2])), &[true, true], 0);
        assert_eq!(wide.samples, Samples::U16(vec![257, 514]));
        let mut narrow = pixels(1, Samples::U8(vec![7, 7]));
        for other in [pixels(1, Samples::U16(vec![1, 2])), pixels(1, Samples::U8(vec![1, 2, 3]))] {
            restore(&mut narrow, &other, &[true, true], 0);
            assert_eq!(narrow.samples, Samples::U8(vec![7, 7]));
        }
    }
}
