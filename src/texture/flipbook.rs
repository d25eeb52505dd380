//! A flipbook: the maps of one sample in several frames, which follow each other in time.

use super::{MapKind, MapSet, Texture};

/// Frames of one size with the same maps, in the order of time; at least one.
///
/// They are kept as a strip, below one another: texel (x, y) of frame t is texel (x, t * height + y) of the strip.
#[derive(Clone, Debug, PartialEq)]
pub struct Flipbook {
    strip: MapSet,
    frames: u32,
}

impl Flipbook {
    /// Joins frames. Panics if there is none, or sizes or maps differ: whoever reads files checks and says so first.
    pub fn new(frames: &[MapSet]) -> Self {
        let first = frames.first().expect("a flipbook without frames");
        let kinds = |set: &MapSet| set.iter().map(|(kind, _)| kind).collect::<Vec<_>>();
        assert!(frames.iter().all(|f| kinds(f) == kinds(first)), "frames with different maps");
        let (w, h) = (first.width(), first.height());
        assert!(frames.iter().all(|f| (f.width(), f.height()) == (w, h)), "frames of different sizes");
        let joined = |kind: MapKind| {
            let parts = frames.iter().filter_map(|f| f.get(kind)).map(Texture::data);
            Texture::from_data(w, h * frames.len() as u32, kind.channels(), parts.collect::<Vec<_>>().concat())
        };
        let strip = MapSet::new(kinds(first).into_iter().map(|kind| (kind, joined(kind))).collect());
        Flipbook { strip, frames: frames.len() as u32 }
    }

    /// A flipbook from its strip; `None` if the strip's height is no multiple of the frames.
    pub fn from_strip(strip: MapSet, frames: u32) -> Option<Self> {
        (frames > 0 && strip.height().is_multiple_of(frames)).then_some(Flipbook { strip, frames })
    }

    /// Texels per row, rows of a frame, frames.
    pub fn size(&self) -> [u32; 3] {
        [self.strip.width(), self.strip.height() / self.frames, self.frames]
    }

    /// The maps of all frames, below one another.
    pub fn strip(&self) -> &MapSet {
        &self.strip
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_stand_below_one_another() {
        let frame = |t: u32| {
            let map = Texture::from_fn(2, 3, 1, |x, y, out| out[0] = (100 * t + 10 * y + x) as f32);
            MapSet::new(vec![(MapKind::Height, map)])
        };
        let book = Flipbook::new(&[frame(0), frame(1), frame(2), frame(3)]);
        assert_eq!(book.size(), [2, 3, 4]);
        assert_eq!(book.strip().get(MapKind::Height).map(|t| t.get(1, 2 * 3 + 1)[0]), Some(211.0));
        assert_eq!(Flipbook::from_strip(book.strip().clone(), 4), Some(book.clone()));
        assert_eq!(Flipbook::from_strip(book.strip().clone(), 5), None);
    }
}
