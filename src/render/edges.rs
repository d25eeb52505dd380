//! The blend metric as a picture: which triangles are blended over their edges, and how much their sides differ there.
//!
//! Source: \[MK03\] 3.3.2, eq. 4, seen from where an edge is as long on the screen as on the surface: the continuity error.
//! Unaware of: where the faces lie in the exemplar, thresholds.

use super::look::{Appearance, Hit, Look};

type V3 = [f32; 3];

/// Colours of what is not blended, and of errors from none to [`MOST`].
const PLAIN: V3 = [0.55, 0.55, 0.5];
const RAMP: [V3; 3] = [[0.05, 0.35, 0.08], [0.9, 0.65, 0.03], [0.75, 0.03, 0.02]];

/// Errors from here on look the same: of unrelated places of a sample with strong contrast.
const MOST: f32 = 0.3;

/// The look of a mesh with the metric of its edges.
pub struct Edges<'a> {
    metric: &'a [[f32; 2]],
}

impl<'a> Edges<'a> {
    /// `metric`: for each corner of each face continuity error and length of the edge that is blended there; none for a
    /// mesh without any.
    pub fn new(metric: &'a [[f32; 2]]) -> Self {
        Edges { metric }
    }
}

/// The colour of an error.
fn ramp(error: f32) -> V3 {
    let at = (error / MOST).clamp(0.0, 1.0) * 2.0;
    let (i, t) = if at < 1.0 { (0, at) } else { (1, at - 1.0) };
    [0, 1, 2].map(|c| RAMP[i][c] * (1.0 - t) + RAMP[i + 1][c] * t)
}

impl Look for Edges<'_> {
    fn appearance(&self, hit: &Hit) -> Appearance {
        // The same at all three corners.
        let [error, length] = self.metric.get(3 * hit.face).copied().unwrap_or_default();
        let color = if length > 0.0 { ramp(error) } else { PLAIN };
        Appearance { color, normal: hit.normal, ..Appearance::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_have_colours_and_what_is_not_blended_has_none() {
        let metric = [[[0.0, 0.0]; 3], [[0.15, 2.0]; 3], [[9.0, 1.0]; 3]].concat();
        let color = |metric: &[[f32; 2]], face: usize| {
            let hit = Hit { face, bary: [1.0, 0.0, 0.0], grad: [[0.0; 2]; 2], normal: [0.0, 0.0, 1.0], front: true };
            Edges::new(metric).appearance(&hit).color
        };
        assert_eq!([0, 1, 2].map(|f| color(&metric, f)), [PLAIN, RAMP[1], RAMP[2]]);
        assert_eq!(color(&[], 1), PLAIN);
    }
}
