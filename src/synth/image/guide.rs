//! Guides: what kind of texture is wanted at each pixel, shown by a map of the canvas and a map of the exemplar in the
//! same colours.
//!
//! Source: texture by numbers, Hertzmann et al.: Image Analogies (2001) 4.3; named as future work in \[ZG02\] section 6.
//! A pixel goes well with a texel if both maps show nearly the same there. Labels painted in flat colours and smooth
//! maps (say, of wear, or of light and dark: [`super::guide_light`]) are treated alike.
//! Reads as: a colour that the exemplar's map does not have asks for the nearest one that it has.
//! Unaware of: jump maps, what the texture shows.

use crate::exemplar::Domain;
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::synth::Error;

/// Difference, as a share of the range, at which a texel still fits a pixel at weight 1.
const FITS: f32 = 1.0 / 15.0;

/// What a difference over the whole range costs at weight 1, in units of the typical contrast. A seam between unlike
/// textures costs 10 to 40 per pixel of its length; with less, corners of painted areas are cut off to shorten it.
const RANGE: f32 = 50.0;

/// Squared difference over the whole range.
const WHOLE: f32 = 3.0 * 255.0 * 255.0;

/// A map of colours, to be compared with another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GuideMap {
    width: u32,
    height: u32,
    /// Squares of `2^square` pixels share a colour; so many squares in a row.
    square: u32,
    columns: u32,
    colours: Vec<[u8; 3]>,
}

impl GuideMap {
    /// Takes one colour per pixel, row by row. Panics if their number is not that of the pixels, or is 0.
    pub fn new([width, height]: [u32; 2], colours: Vec<[u8; 3]>) -> Self {
        assert!(!colours.is_empty(), "a guide without pixels");
        assert_eq!(colours.len(), width as usize * height as usize, "pixels of a guide");
        GuideMap { width, height, square: 0, columns: width, colours }
    }

    /// Computes every colour by `f(x, y)`.
    pub fn from_fn([width, height]: [u32; 2], f: impl Fn(u32, u32) -> [u8; 3]) -> Self {
        GuideMap::new(
            [width, height],
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| f(x, y)).collect(),
        )
    }

    /// Computes one colour for each square of `2^square` pixels, by `f(x, y)` of its first pixel.
    pub fn coarse([width, height]: [u32; 2], square: u32, f: impl Fn(u32, u32) -> [u8; 3] + Sync) -> Self {
        let [columns, rows] = [width, height].map(|side| side.div_ceil(1 << square));
        let row = |y: usize| (0..columns).map(|x| f(x << square, (y as u32) << square)).collect::<Vec<_>>();
        GuideMap { width, height, square, columns, colours: par::map(rows as usize, row).concat() }
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// All colours, row by row: one per pixel, or per square.
    pub fn colours(&self) -> &[[u8; 3]] {
        &self.colours
    }

    #[inline(always)]
    fn get(&self, x: u32, y: u32) -> [u8; 3] {
        self.colours[(y >> self.square) as usize * self.columns as usize + (x >> self.square) as usize]
    }
}

/// A guide for a canvas and an exemplar.
#[derive(Clone, Debug)]
pub struct Guide {
    target: GuideMap,
    exemplar: GuideMap,
    weight: f32,
    /// Texels of the domain by class of colour.
    texels: Vec<Vec<[u16; 2]>>,
    /// For each class, what pixels of such a colour get.
    wanted: Vec<Wanted>,
}

/// What pixels of a class of colours get.
#[derive(Clone, Copy, Debug, Default)]
struct Wanted {
    /// The entry of `texels` that comes nearest.
    texels: u32,
    /// Greatest squared difference that fits.
    most: f32,
}

impl Guide {
    /// Prepares a guide: `target` of the canvas' size, `exemplar` of the domain's. `weight` (0..=100) is what differences
    /// count against seams; 1 keeps painted areas in shape, 0 steers nothing. Fails if the exemplar's size or the weight
    /// do not fit.
    pub fn new(target: GuideMap, exemplar: GuideMap, domain: &Domain, weight: f32) -> Result<Self, Error> {
        let (found, expected) = (exemplar.size(), [domain.width(), domain.height()]);
        if found != expected {
            return Err(Error::TextureSize { found, expected });
        }
        if !(0.0..=100.0).contains(&weight) {
            return Err(Error::GuideWeight(weight));
        }
        let mut texels = vec![vec![]; CLASSES];
        for (x, y) in (0..domain.height()).flat_map(|y| (0..domain.width()).map(move |x| (x, y))) {
            if domain.contains(x as i32, y as i32) {
                texels[class(exemplar.get(x, y))].push([x as u16, y as u16]);
            }
        }
        let mut asked_for = vec![false; CLASSES];
        target.colours.iter().for_each(|c| asked_for[class(*c)] = true);
        let there: Vec<usize> = (0..CLASSES).filter(|c| !texels[*c].is_empty()).collect();
        let tolerance = FITS * WHOLE.sqrt() / weight.sqrt();
        let wanted = |c: usize| {
            let away = |t: &&usize| squared(middle(c), middle(**t));
            let nearest = there.iter().min_by_key(away).filter(|_| asked_for[c])?;
            let reach = (squared(middle(c), middle(*nearest)) as f32).sqrt() + tolerance;
            Some(Wanted { texels: *nearest as u32, most: reach * reach })
        };
        let wanted = (0..CLASSES).map(|c| wanted(c).unwrap_or_default()).collect();
        Ok(Guide { target, exemplar, weight, texels, wanted })
    }

    /// Size of the canvas that the guide is for.
    pub fn canvas(&self) -> [u32; 2] {
        self.target.size()
    }

    #[inline(always)]
    fn difference(&self, [x, y]: [u32; 2], [u, v]: [u16; 2]) -> f32 {
        squared(self.target.get(x, y), self.exemplar.get(u.into(), v.into())) as f32
    }

    /// What a texel costs at a pixel, in units of the typical contrast.
    #[inline(always)]
    pub(super) fn cost(&self, pixel: [u32; 2], texel: [u16; 2]) -> f32 {
        self.difference(pixel, texel) * (self.weight * (RANGE / WHOLE))
    }

    /// True if a texel goes well with a pixel.
    #[inline(always)]
    pub(super) fn fits(&self, [x, y]: [u32; 2], texel: [u16; 2]) -> bool {
        self.difference([x, y], texel) <= self.wanted[class(self.target.get(x, y))].most
    }

    /// A random texel of those that go best with a pixel.
    pub(super) fn seed(&self, [x, y]: [u32; 2], draws: Key) -> [u16; 2] {
        let texels = &self.texels[self.wanted[class(self.target.get(x, y))].texels as usize];
        texels[draws.below(1, texels.len() as u32) as usize]
    }
}

/// Classes of colours by which texels are sorted for [`Guide::seed`]: four bits of each channel.
const CLASSES: usize = 1 << 12;

#[inline(always)]
fn class([r, g, b]: [u8; 3]) -> usize {
    usize::from(r >> 4) << 8 | usize::from(g >> 4) << 4 | usize::from(b >> 4)
}

/// The colour in the middle of a class.
fn middle(class: usize) -> [u8; 3] {
    [8, 4, 0].map(|shift| ((class >> shift & 15) << 4 | 8) as u8)
}

#[inline(always)]
fn squared(a: [u8; 3], b: [u8; 3]) -> u32 {
    let d = |i: usize| u32::from(a[i].abs_diff(b[i]));
    d(0) * d(0) + d(1) * d(1) + d(2) * d(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::Wrap;

    fn grey(size: [u32; 2], f: impl Fn(u32, u32) -> u8) -> GuideMap {
        GuideMap::from_fn(size, |x, y| [f(x, y); 3])
    }

    #[test]
    fn seeds_come_from_the_nearest_colour() {
        let stripes = grey([4, 2], |x, _| (x / 2) as u8 * 255);
        let target = grey([3, 1], |x, _| [0, 60, 230][x as usize]);
        let domain = Domain::masked(4, 2, Wrap::Clamp, |x, y| x != 3 || y != 0).unwrap();
        let guide = Guide::new(target, stripes, &domain, 2.0).unwrap();
        for draw in 0..50 {
            let key = Key::new(draw);
            assert!(guide.seed([0, 0], key)[0] < 2 && guide.seed([1, 0], key)[0] < 2);
            let s = guide.seed([2, 0], key);
            assert!(s[0] >= 2 && s != [3, 0]);
        }
        assert_eq!(guide.cost([0, 0], [2, 0]), 2.0 * RANGE);
    }

    #[test]
    fn the_nearest_colour_there_is_fits_and_others_do_not() {
        let stripes = grey([4, 1], |x, _| [20, 40, 200, 220][x as usize]);
        let target = grey([4, 1], |x, _| [20, 30, 120, 255][x as usize]);
        let full = Domain::full(4, 1, Wrap::Clamp);
        let fits = |weight: f32| {
            let guide = Guide::new(target.clone(), stripes.clone(), &full, weight).unwrap();
            (0..4).map(|x| (0..4u16).filter(|u| guide.fits([x, 0], [*u, 0])).collect::<Vec<_>>()).collect::<Vec<_>>()
        };
        // 120 lies halfway between: two texels come near.
        assert_eq!(fits(1.0), [vec![0], vec![0, 1], vec![1, 2], vec![3]]);
        // A tenth of the weight: three times the tolerance.
        assert_eq!(fits(0.1)[0], [0, 1]);
        assert!(fits(0.0).iter().all(|f| f.len() == 4));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let map = |w, h| grey([w, h], |_, _| 0);
        let fault = |h, weight| {
            let domain = Domain::full(4, h, Wrap::Clamp);
            Guide::new(map(3, 3), map(4, 2), &domain, weight).map(|g| g.canvas()).map_err(|e| e.to_string())
        };
        assert_eq!(fault(2, 1.0), Ok([3, 3]));
        assert_eq!(fault(3, 1.0), Err("a texture or jump map of 4 x 2 for an exemplar of 4 x 3 texels".into()));
        for weight in [f32::NAN, -1.0, 101.0] {
            assert_eq!(fault(2, weight), Err(format!("a guide of weight {weight}: expected a number in 0..=100")));
        }
    }
}
