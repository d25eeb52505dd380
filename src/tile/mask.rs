//! Feature masks: which texels of a tile belong to a feature.
//!
//! Source: \[MST09\] section 1, F_m. Unaware of: where masks come from.

use crate::texture::Texture;

/// A binary picture on the torus, row by row from the top: true inside features.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    width: u32,
    on: Vec<bool>,
}

impl Mask {
    /// Takes `width` times any number of texels, row by row. Panics if there is none, or no whole number of rows.
    pub fn new(width: u32, on: Vec<bool>) -> Self {
        assert!(
            width > 0 && !on.is_empty() && on.len().is_multiple_of(width as usize),
            "a mask of {} texels",
            on.len()
        );
        Mask { width, on }
    }

    /// Computes every texel by `f(x, y)`.
    pub fn from_fn(width: u32, height: u32, f: impl Fn(u32, u32) -> bool) -> Self {
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Mask::new(width, texels.map(|(x, y)| f(x, y)).collect())
    }

    /// The texels of a picture that are above one half.
    pub fn of_texture(picture: &Texture) -> Self {
        Mask::from_fn(picture.width(), picture.height(), |x, y| picture.get(x, y)[0] > 0.5)
    }

    /// Texels per row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        (self.on.len() / self.width as usize) as u32
    }

    /// All texels, row by row.
    pub fn data(&self) -> &[bool] {
        &self.on
    }

    /// Whether texel (x, y) is inside a feature. Panics outside the mask.
    pub fn get(&self, x: u32, y: u32) -> bool {
        self.on[y as usize * self.width as usize + x as usize]
    }

    /// Texels inside features.
    pub fn count(&self) -> usize {
        self.on.iter().filter(|on| **on).count()
    }

    /// True if there is both inside and outside.
    pub fn is_mixed(&self) -> bool {
        (1..self.on.len()).contains(&self.count())
    }

    /// Texels in which two masks of one size differ.
    pub fn differing(&self, other: &Mask) -> usize {
        self.on.iter().zip(&other.on).filter(|(a, b)| a != b).count()
    }
}
