//! Guides: what kind of texture is wanted at each pixel, shown by a map of the canvas and a map of the exemplar in the
//! same colours.
//!
//! Source: texture by numbers, Hertzmann et al.: Image Analogies (2001) 4.3; named as future work in \[ZG02\] section 6.
//! A pixel goes well with a texel if both maps show nearly the same there. Labels painted in flat colours and smooth
//! maps (say, of wear) are treated alike.
//! Unaware of: jump maps, what the texture shows.

use super::Error;
use crate::exemplar::Domain;
use crate::numerics::rng::Key;
use crate::texture::Texture;
use std::collections::BTreeMap;

/// Most squared difference at which a texel still fits a pixel: a fifteenth of the range.
const FITS: f32 = 0.0045;

/// Steps per channel by which texels are sorted for [`Guide::seed`].
const STEPS: f32 = 15.0;

/// A guide for a canvas and an exemplar.
#[derive(Clone, Debug)]
pub struct Guide {
    target: Texture,
    exemplar: Texture,
    weight: f32,
    /// Texels of the domain by colour.
    texels: Vec<Vec<[u16; 2]>>,
    /// For each colour of the target, the entry of `texels` that comes nearest.
    nearest: BTreeMap<u32, usize>,
}

impl Guide {
    /// Prepares a guide: `target` of the canvas' size, `exemplar` of the domain's, values in 0..=1, as many channels (at
    /// most 4). `weight` (0..=100) is what a difference over the whole range costs against seams; 1 is a good start.
    /// Fails if sizes, channels or the weight do not fit.
    pub fn new(target: Texture, exemplar: Texture, domain: &Domain, weight: f32) -> Result<Self, Error> {
        let (found, expected) = ([exemplar.width(), exemplar.height()], [domain.width(), domain.height()]);
        if found != expected {
            return Err(Error::TextureSize { found, expected });
        }
        if target.channels() != exemplar.channels() || target.channels() > 4 {
            return Err(Error::GuideChannels { target: target.channels(), exemplar: exemplar.channels() });
        }
        if !(0.0..=100.0).contains(&weight) {
            return Err(Error::GuideWeight(weight));
        }
        let mut by_colour: BTreeMap<u32, Vec<[u16; 2]>> = BTreeMap::new();
        for (x, y) in (0..domain.height()).flat_map(|y| (0..domain.width()).map(move |x| (x, y))) {
            if domain.contains(x as i32, y as i32) {
                by_colour.entry(colour(exemplar.get(x, y))).or_default().push([x as u16, y as u16]);
            }
        }
        let colours: Vec<u32> = by_colour.keys().copied().collect();
        let mut nearest = BTreeMap::new();
        for texel in target.data().chunks_exact(target.channels() as usize) {
            let wanted = colour(texel);
            nearest.entry(wanted).or_insert_with(|| {
                let away =
                    |i: &usize| (0..4).map(|c| component(colours[*i], c).abs_diff(component(wanted, c)).pow(2)).sum();
                (0..colours.len()).min_by_key::<u32, _>(away).unwrap_or_default()
            });
        }
        Ok(Guide { target, exemplar, weight, texels: by_colour.into_values().collect(), nearest })
    }

    /// Size of the canvas that the guide is for.
    pub fn canvas(&self) -> [u32; 2] {
        [self.target.width(), self.target.height()]
    }

    /// Squared difference of the two maps at a pixel of the canvas and a texel, 0..=1 per channel.
    #[inline]
    pub(super) fn difference(&self, [x, y]: [u32; 2], [u, v]: [u16; 2]) -> f32 {
        let (a, b) = (self.target.get(x, y), self.exemplar.get(u.into(), v.into()));
        a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
    }

    /// What a texel costs at a pixel.
    #[inline]
    pub(super) fn cost(&self, pixel: [u32; 2], texel: [u16; 2]) -> f32 {
        self.weight * self.difference(pixel, texel)
    }

    /// True if a texel goes well with a pixel.
    #[inline]
    pub(super) fn fits(&self, pixel: [u32; 2], texel: [u16; 2]) -> bool {
        self.weight == 0.0 || self.difference(pixel, texel) <= FITS
    }

    /// A random texel of those that go best with a pixel.
    pub(super) fn seed(&self, [x, y]: [u32; 2], draws: Key) -> [u16; 2] {
        let texels = &self.texels[self.nearest[&colour(self.target.get(x, y))]];
        texels[draws.below(1, texels.len() as u32) as usize]
    }
}

/// Up to four values as bytes of a number, in [`STEPS`] steps.
fn colour(values: &[f32]) -> u32 {
    values.iter().fold(0, |all, v| all << 8 | (v.clamp(0.0, 1.0) * STEPS + 0.5) as u32)
}

fn component(colour: u32, i: u32) -> u32 {
    colour >> (8 * i) & 0xff
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::Wrap;

    #[test]
    fn seeds_come_from_the_nearest_colour() {
        let stripes = Texture::from_fn(4, 2, 1, |x, _, out| out[0] = (x / 2) as f32);
        let target = Texture::from_fn(3, 1, 1, |x, _, out| out[0] = [0.0, 0.2, 0.9][x as usize]);
        let domain = Domain::masked(4, 2, Wrap::Clamp, |x, y| x != 3 || y != 0).unwrap();
        let guide = Guide::new(target, stripes.clone(), &domain, 2.0).unwrap();
        for draw in 0..50 {
            let key = Key::new(draw);
            assert!(guide.seed([0, 0], key)[0] < 2 && guide.seed([1, 0], key)[0] < 2);
            let s = guide.seed([2, 0], key);
            assert!(s[0] >= 2 && s != [3, 0]);
        }
        assert!(guide.fits([0, 0], [1, 1]) && !guide.fits([1, 0], [1, 1]));
        assert_eq!(guide.cost([0, 0], [2, 0]), 2.0);
        let fault = Guide::new(stripes.clone(), stripes.clone(), &Domain::full(4, 3, Wrap::Clamp), 1.0).unwrap_err();
        assert_eq!(fault.to_string(), "a texture or jump map of 4 x 2 for an exemplar of 4 x 3 texels");
        let full = Domain::full(4, 2, Wrap::Clamp);
        assert!(Guide::new(stripes.clone(), stripes.clone(), &full, f32::NAN).is_err());
        let color = Texture::from_fn(4, 2, 3, |_, _, out| out.fill(0.0));
        assert!(Guide::new(color, stripes, &full, 1.0).is_err());
    }
}
