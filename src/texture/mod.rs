//! Images of f32 and sets of maps that belong to one sample.
//!
//! Rows run top to bottom. A [`Texel`] position has its origin at the outer corner of texel (0, 0); texel centres lie
//! at +0.5. glTF's v points down as well, so [`Uv`] is a texel position divided by the size, nothing flipped. Colour is
//! linear; sRGB exists only in `io` and in [`color`].

pub mod color;
mod flipbook;
mod map_set;

pub use flipbook::Flipbook;
pub use map_set::{MapKind, MapSet};

/// A position in a texture in texels, x right and y down, origin at the outer corner of texel (0, 0).
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Texel {
    /// Right, in texels.
    pub x: f32,
    /// Down, in texels.
    pub y: f32,
}

/// A position in a texture as a share of its size: 0..1 right, 0..1 down (as in glTF).
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Uv {
    /// Right, 0..1.
    pub u: f32,
    /// Down, 0..1.
    pub v: f32,
}

/// Builds a [`Texel`].
pub const fn texel(x: f32, y: f32) -> Texel {
    Texel { x, y }
}

/// What lies outside a texture's borders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// The nearest border texel.
    Clamp,
    /// The texture again (a torus).
    Repeat,
}

impl Wrap {
    /// Index in 0..n for any integer index.
    pub fn index(self, i: i64, n: u32) -> u32 {
        let n = i64::from(n);
        match self {
            Wrap::Clamp => i.clamp(0, n - 1) as u32,
            Wrap::Repeat => i.rem_euclid(n) as u32,
        }
    }
}

/// A rectangle of texels with interleaved f32 channels, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    width: u32,
    height: u32,
    channels: u32,
    data: Vec<f32>,
}

impl Texture {
    /// A texture of zeros. Panics if a side or `channels` is zero.
    pub fn new(width: u32, height: u32, channels: u32) -> Self {
        let len = width as usize * height as usize * channels as usize;
        Self::from_data(width, height, channels, vec![0.0; len])
    }

    /// Takes `width * height * channels` interleaved values. Panics if a side is zero or the length differs.
    pub fn from_data(width: u32, height: u32, channels: u32, data: Vec<f32>) -> Self {
        assert!(width > 0 && height > 0 && channels > 0, "an empty texture: {width}x{height}x{channels}");
        assert_eq!(data.len(), width as usize * height as usize * channels as usize, "length of texture data");
        Texture { width, height, channels, data }
    }

    /// Computes every texel by `f(x, y, out)`, in parallel by rows.
    pub fn from_fn(width: u32, height: u32, channels: u32, f: impl Fn(u32, u32, &mut [f32]) + Sync) -> Self {
        let mut t = Self::new(width, height, channels);
        let (c, row) = (channels as usize, width as usize * channels as usize);
        crate::numerics::par::for_rows(&mut t.data, row, |y, row| {
            for (x, out) in row.chunks_exact_mut(c).enumerate() {
                f(x as u32, y as u32, out);
            }
        });
        t
    }

    /// This texture of three channels with another's one channel as the fourth. Panics if sizes or channels differ.
    pub fn with_alpha(&self, alpha: &Texture) -> Texture {
        assert_eq!(
            (alpha.width, alpha.height, alpha.channels, self.channels),
            (self.width, self.height, 1, 3),
            "alpha"
        );
        Texture::from_fn(self.width, self.height, 4, |x, y, out| {
            out[..3].copy_from_slice(self.get(x, y));
            out[3] = alpha.get(x, y)[0];
        })
    }

    /// Texels per row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Values per texel.
    pub fn channels(&self) -> u32 {
        self.channels
    }

    /// Number of texels.
    pub fn texel_count(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// All values, row by row, channels interleaved.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// All values, row by row, channels interleaved.
    pub fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// The channels of texel (x, y). Panics outside.
    pub fn get(&self, x: u32, y: u32) -> &[f32] {
        let c = self.channels as usize;
        let at = (y as usize * self.width as usize + x as usize) * c;
        &self.data[at..at + c]
    }

    /// The channels of texel (x, y). Panics outside.
    pub fn get_mut(&mut self, x: u32, y: u32) -> &mut [f32] {
        let c = self.channels as usize;
        let at = (y as usize * self.width as usize + x as usize) * c;
        &mut self.data[at..at + c]
    }

    /// Bilinear sample at `pos` into `out` (one value per channel), as a GPU filters without mip levels.
    pub fn sample(&self, pos: Texel, wrap: Wrap, out: &mut [f32]) {
        let (fx, fy) = (pos.x - 0.5, pos.y - 0.5);
        let (x0, y0) = (fx.floor(), fy.floor());
        let (tx, ty) = (fx - x0, fy - y0);
        let (x0, y0) = (x0 as i64, y0 as i64);
        let (xa, xb) = (wrap.index(x0, self.width), wrap.index(x0 + 1, self.width));
        let (ya, yb) = (wrap.index(y0, self.height), wrap.index(y0 + 1, self.height));
        let (aa, ba, ab, bb) = (self.get(xa, ya), self.get(xb, ya), self.get(xa, yb), self.get(xb, yb));
        for (i, o) in out.iter_mut().enumerate().take(self.channels as usize) {
            let top = aa[i] * (1.0 - tx) + ba[i] * tx;
            let bottom = ab[i] * (1.0 - tx) + bb[i] * tx;
            *o = top * (1.0 - ty) + bottom * ty;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampling_at_centres_is_exact_and_between_is_the_mean() {
        let t = Texture::from_data(2, 1, 1, vec![1.0, 3.0]);
        let mut out = [0.0];
        t.sample(texel(0.5, 0.5), Wrap::Clamp, &mut out);
        assert_eq!(out, [1.0]);
        t.sample(texel(1.0, 0.5), Wrap::Clamp, &mut out);
        assert_eq!(out, [2.0]);
        t.sample(texel(2.0, 0.5), Wrap::Clamp, &mut out);
        assert_eq!(out, [3.0]);
        t.sample(texel(2.0, 0.5), Wrap::Repeat, &mut out);
        assert_eq!(out, [2.0]);
    }
}
