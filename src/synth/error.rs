//! What can be wrong with the inputs of a synthesis.

use std::fmt;

/// Why a synthesis could not be made. Every value is what was found.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// `patch`, in exemplar sides, must be positive and finite.
    Patch(f64),
    /// `border_band`, a share of the exemplar, must lie in 0..=0.5.
    BorderBand(f64),
    /// Output size in pixels: sides at least 1, at most [`MAX_PIXELS`] in all.
    ImageSize([u32; 2]),
    /// Width, height and frames of an output flipbook: at least 1 each, at most `volume::walk::MAX_VOLUME` in all.
    VolumeSize([u32; 3]),
    /// Sides of an exemplar must lie in 1..=65535.
    ExemplarSize([u32; 2]),
    /// Number of offsets against number of half-edges.
    OffsetCount {
        /// Offsets given.
        found: usize,
        /// Half-edges of the mesh.
        expected: usize,
    },
    /// An offset is NaN or infinite.
    Offset {
        /// Vertex that the half-edge starts from.
        from: u32,
        /// Vertex that it points to.
        to: u32,
    },
    /// The edges around a vertex span more texels than the exemplar has: no address is valid.
    BoxTooLarge {
        /// The vertex that is worst off.
        vertex: u32,
        /// Texels spanned by its edges, across and down.
        span: [f64; 2],
        /// Size of the exemplar in texels.
        exemplar: [u32; 2],
    },
    /// The order is not one of all vertices, each once.
    Order {
        /// The vertex that is repeated, out of range or (if equal to the number of vertices) missing.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A texture or jump map of another size than the exemplar.
    TextureSize {
        /// Its size in texels.
        found: [u32; 2],
        /// Size of the exemplar.
        expected: [u32; 2],
    },
    /// A guide's map of the canvas of another size than that.
    GuideSize {
        /// Its size in pixels.
        found: [u32; 2],
        /// Size of the canvas.
        expected: [u32; 2],
    },
    /// The weight of a guide, must lie in 0..=100.
    GuideWeight(f32),
    /// Places that quilting ranks for each piece.
    Candidates {
        /// Places asked for.
        found: u32,
        /// Most places.
        max: u32,
    },
    /// A face does not fit into the exemplar.
    FaceTooLarge {
        /// The face.
        face: usize,
        /// Texels that it takes, across and down.
        span: [f64; 2],
        /// Size of the exemplar in texels.
        exemplar: [u32; 2],
    },
    /// The continuity error above which edges are blended: must be a number, zero or more.
    Threshold(f64),
    /// An element of a list that must have one entry per vertex or corner.
    Count {
        /// What is counted.
        what: &'static str,
        /// Entries given.
        found: usize,
        /// Entries needed.
        expected: usize,
    },
}

/// Most pixels of an output image: 16384 x 16384.
pub const MAX_PIXELS: u64 = 1 << 28;

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Error::Patch(p) => write!(f, "patch = {p}: expected a positive number of exemplar sides"),
            Error::BorderBand(b) => write!(f, "border band = {b}: expected a share of the exemplar in 0..=0.5"),
            Error::ImageSize([w, h]) => {
                write!(
                    f,
                    "output of {w} x {h} pixels: each side must be at least 1 and the product at most {MAX_PIXELS}"
                )
            }
            Error::VolumeSize([w, h, frames]) => write!(
                f,
                "output of {frames} frames of {w} x {h} pixels: each must be at least 1 and the product at most {}",
                super::volume::walk::MAX_VOLUME
            ),
            Error::ExemplarSize([w, h]) => write!(f, "exemplar of {w} x {h} texels: sides must be in 1..=65535"),
            Error::OffsetCount { found, expected } => {
                write!(f, "{found} edge offsets for {expected} half-edges: expected one per half-edge")
            }
            Error::Offset { from, to } => write!(f, "the offset from vertex {from} to vertex {to} is not finite"),
            Error::BoxTooLarge { vertex, span: [x, y], exemplar: [w, h] } => {
                let (rx, ry) = (f64::from(w) - 1.0, f64::from(h) - 1.0);
                let factor = (rx / x).min(ry / y);
                write!(
                    f,
                    "the edges at vertex {vertex} span {x:.1} x {y:.1} texels, but an exemplar of {w} x {h} has room for \
                     {rx:.0} x {ry:.0}: lower the scale (to {factor:.3} of the present one), subdivide the mesh or use \
                     a larger exemplar"
                )
            }
            Error::Order { vertex, vertices } => {
                write!(f, "vertex {vertex} of {vertices} is missing, repeated or out of range in the order")
            }
            Error::TextureSize { found: [w, h], expected: [ew, eh] } => {
                write!(f, "a texture or jump map of {w} x {h} for an exemplar of {ew} x {eh} texels")
            }
            Error::GuideSize { found: [w, h], expected: [ew, eh] } => {
                write!(f, "a guide of {w} x {h} pixels for a canvas of {ew} x {eh}")
            }
            Error::GuideWeight(w) => write!(f, "a guide of weight {w}: expected a number in 0..=100"),
            Error::Candidates { found, max } => write!(f, "candidates = {found}: expected 1..={max}"),
            Error::FaceTooLarge { face, span: [x, y], exemplar: [w, h] } => write!(
                f,
                "face {face} takes {x:.1} x {y:.1} texels, but an exemplar of {w} x {h} has room for {} x {}: lower the scale, \
                 subdivide the mesh or use a larger exemplar",
                w - 1,
                h - 1
            ),
            Error::Threshold(t) => write!(f, "a blend threshold of {t}: expected a number of at least 0"),
            Error::Count { what, found, expected } => write!(f, "{found} {what}: expected {expected}"),
        }
    }
}

impl std::error::Error for Error {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_that_does_not_fit_says_what_to_do() {
        let e = Error::BoxTooLarge { vertex: 7, span: [510.0, 20.0], exemplar: [256, 128] };
        assert_eq!(
            e.to_string(),
            "the edges at vertex 7 span 510.0 x 20.0 texels, but an exemplar of 256 x 128 has room for 255 x 127: \
             lower the scale (to 0.500 of the present one), subdivide the mesh or use a larger exemplar"
        );
    }
}
