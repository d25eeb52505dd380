//! Orders in which the pixels of an image are synthesised.
//!
//! Source: \[ZG02\] section 3.2. The papers' Hilbert curve fills squares of a power of two; this is its generalisation to
//! any rectangle by recursive halving: a rectangle along a major axis is cut into two along that axis if it is long,
//! else into three (up half the minor axis, across, down again), halves being made even so that every part can be
//! entered and left at neighbouring pixels. A path between the two corners of a side exists unless that side is odd and
//! the other even (colour the pixels as a chessboard); the major axis is chosen so that this never happens, hence every
//! step goes to one of the four neighbours, for every size (test `every_step_is_to_a_neighbour`).
//! Unaware of: what is done at a pixel.

/// Order of the pixels of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageOrder {
    /// Row by row, each left to right. Patches grow right and down; the fastest.
    Scanline,
    /// Row by row, directions alternating: patches of more regular shape at the same speed.
    Serpentine,
    /// Along a Hilbert curve: all four neighbours serve equally often, patches are roundest.
    Hilbert,
}

impl ImageOrder {
    /// Every order.
    pub const ALL: [ImageOrder; 3] = [ImageOrder::Scanline, ImageOrder::Serpentine, ImageOrder::Hilbert];

    /// Calls `visit(x, y)` once for every pixel of a `width` x `height` image, in this order.
    pub fn for_each(self, width: u32, height: u32, mut visit: impl FnMut(u32, u32)) {
        match self {
            ImageOrder::Scanline => (0..height).for_each(|y| (0..width).for_each(|x| visit(x, y))),
            ImageOrder::Serpentine => {
                for y in 0..height {
                    if y % 2 == 0 {
                        (0..width).for_each(|x| visit(x, y));
                    } else {
                        (0..width).rev().for_each(|x| visit(x, y));
                    }
                }
            }
            ImageOrder::Hilbert => hilbert_image(width, height, &mut visit),
        }
    }
}

/// A vector along one image axis.
#[derive(Clone, Copy)]
struct Axis {
    x: i64,
    y: i64,
}

impl Axis {
    fn length(self) -> i64 {
        (self.x + self.y).abs()
    }

    fn unit(self) -> Axis {
        Axis { x: self.x.signum(), y: self.y.signum() }
    }

    fn plus(self, o: Axis) -> Axis {
        Axis { x: self.x + o.x, y: self.y + o.y }
    }

    fn minus(self, o: Axis) -> Axis {
        Axis { x: self.x - o.x, y: self.y - o.y }
    }

    fn negated(self) -> Axis {
        Axis { x: -self.x, y: -self.y }
    }

    /// About half, rounded to an even length where the whole is longer than two.
    fn half(self) -> Axis {
        let half = Axis { x: self.x / 2, y: self.y / 2 };
        if half.length() % 2 == 1 && self.length() > 2 { half.plus(self.unit()) } else { half }
    }
}

fn hilbert_image(width: u32, height: u32, visit: &mut impl FnMut(u32, u32)) {
    if width == 0 || height == 0 {
        return;
    }
    let (right, down) = (Axis { x: i64::from(width), y: 0 }, Axis { x: 0, y: i64::from(height) });
    let (long, short) = if width >= height { (right, down) } else { (down, right) };
    let parity_forbids = long.length() % 2 == 1 && short.length() % 2 == 0;
    let (major, minor) = if parity_forbids { (short, long) } else { (long, short) };
    hilbert(Axis { x: 0, y: 0 }, major, minor, visit);
}

/// Visits the rectangle spanned by `major` and `minor` from the pixel `at` in one of its corners to the pixel at the
/// other end of the major side.
fn hilbert(at: Axis, major: Axis, minor: Axis, visit: &mut impl FnMut(u32, u32)) {
    let (across, up) = (major.unit(), minor.unit());
    if minor.length() == 1 || major.length() == 1 {
        let (count, step) = if minor.length() == 1 { (major.length(), across) } else { (minor.length(), up) };
        let mut p = at;
        for _ in 0..count {
            visit(p.x as u32, p.y as u32);
            p = p.plus(step);
        }
        return;
    }
    if 2 * major.length() > 3 * minor.length() {
        let half = major.half();
        hilbert(at, half, minor, visit);
        hilbert(at.plus(half), major.minus(half), minor, visit);
        return;
    }
    let (rise, run) = (minor.half(), Axis { x: major.x / 2, y: major.y / 2 });
    hilbert(at, rise, run, visit);
    hilbert(at.plus(rise), major, minor.minus(rise), visit);
    let last = at.plus(major.minus(across)).plus(rise.minus(up));
    hilbert(last, rise.negated(), major.minus(run).negated(), visit);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pixels(order: ImageOrder, w: u32, h: u32) -> Vec<(u32, u32)> {
        let mut out = vec![];
        order.for_each(w, h, |x, y| out.push((x, y)));
        out
    }

    fn assert_visits_each_once(order: ImageOrder, w: u32, h: u32) {
        let mut seen = pixels(order, w, h);
        seen.sort_unstable_by_key(|&(x, y)| (y, x));
        assert_eq!(seen, pixels(ImageOrder::Scanline, w, h), "{order:?} {w}x{h}");
    }

    #[test]
    fn small_orders() {
        assert_eq!(pixels(ImageOrder::Scanline, 2, 2), [(0, 0), (1, 0), (0, 1), (1, 1)]);
        assert_eq!(pixels(ImageOrder::Serpentine, 2, 3), [(0, 0), (1, 0), (1, 1), (0, 1), (0, 2), (1, 2)]);
        assert_eq!(pixels(ImageOrder::Hilbert, 2, 2), [(0, 0), (0, 1), (1, 1), (1, 0)]);
        let four = pixels(ImageOrder::Hilbert, 4, 4);
        assert_eq!(four[..4], [(0, 0), (1, 0), (1, 1), (0, 1)]);
        assert_eq!(four[15], (3, 0));
        assert_eq!(pixels(ImageOrder::Hilbert, 0, 5), []);
    }

    #[test]
    fn every_step_is_to_a_neighbour() {
        for w in 1..=40u32 {
            for h in 1..=40u32 {
                let path = pixels(ImageOrder::Hilbert, w, h);
                assert_visits_each_once(ImageOrder::Hilbert, w, h);
                for s in path.windows(2) {
                    let far = s[0].0.abs_diff(s[1].0) + s[0].1.abs_diff(s[1].1);
                    assert_eq!(far, 1, "{w}x{h}: {:?} to {:?}", s[0], s[1]);
                }
            }
        }
    }

    proptest! {
        #[test]
        fn each_pixel_is_visited_once(w in 1u32..200, h in 1u32..200) {
            for order in ImageOrder::ALL {
                assert_visits_each_once(order, w, h);
            }
        }
    }

    #[test]
    fn the_hilbert_order_stays_local() {
        // Any 256 successive pixels of a 256 x 256 image fit into a small box.
        let path = pixels(ImageOrder::Hilbert, 256, 256);
        for run in path.windows(256).step_by(64) {
            let span = |f: fn(&(u32, u32)) -> u32| run.iter().map(f).max().unwrap() - run.iter().map(f).min().unwrap();
            assert!(span(|p| p.0).max(span(|p| p.1)) <= 64);
        }
    }
}
