//! The third coordinate: m at every vertex.
//!
//! Source: `[MST09]` 2.2 (Laplacian smoothing of the user's values, clamped to 0..1) and figure 14: a tile whose layers
//! share one mask hides its period if m varies over the surface for no reason.
//! Reads as: values between constraints are harmonic, so that none lies beyond those given, and the clamp is only
//! against rounding. Without a constraint m is 0, the first key. Parts of a building that do not touch should weather as
//! those around them: a component without a constraint goes by all of them, the nearer the more.
//! Unaware of: layers.

use super::Error;
use crate::field::{self, Elsewhere, ScalarConstraint};
use crate::mesh::{Topology, TriMesh};
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::numerics::vec::Vec3;

/// m at every vertex from values at points, each in 0..=1.
pub fn material(
    mesh: &TriMesh,
    topo: &Topology,
    constraints: &[ScalarConstraint],
) -> Result<Vec<f32>, Box<dyn std::error::Error + Send + Sync>> {
    if let Some(index) = constraints.iter().position(|c| !(0.0..=1.0).contains(&c.value)) {
        return Err(Error::Material { index, value: constraints[index].value }.into());
    }
    let m = field::interpolate(mesh, topo, "material", constraints, Elsewhere::Around(0.0))?;
    Ok(m.iter().map(|m| m.clamp(0.0, 1.0) as f32).collect())
}

/// m at every vertex that wanders through 0..=1 over distances of `length` world units: smooth noise of a seed.
pub fn wandering(mesh: &TriMesh, length: f64, seed: u64) -> Vec<f32> {
    par::map(mesh.positions.len(), |v| {
        let noise = value_noise(mesh.positions[v] / length, Key::new(seed).with(NOISE));
        // Eight values' mean keeps to the middle: spread out, so that all layers are seen.
        ((noise - 0.5) * SPREAD + 0.5).clamp(0.0, 1.0) as f32
    })
}

/// Purpose of the random numbers.
const NOISE: u64 = 0x6d61_7465_7269_616c;
/// Gain about the middle.
const SPREAD: f64 = 1.6;

/// Smooth noise, 0..=1: random values at whole positions, between them by smooth steps.
fn value_noise(p: Vec3, key: Key) -> f64 {
    let cell = [p.x.floor(), p.y.floor(), p.z.floor()];
    let share = [p.x - cell[0], p.y - cell[1], p.z - cell[2]].map(|t| t * t * (3.0 - 2.0 * t));
    let mut sum = 0.0;
    for corner in 0..8u32 {
        let (mut weight, mut at) = (1.0, key);
        for axis in 0..3 {
            let far = corner >> axis & 1;
            weight *= if far == 1 { share[axis] } else { 1.0 - share[axis] };
            at = at.with((cell[axis] as i64 + i64::from(far)) as u64);
        }
        sum += weight * at.unit(0);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;

    #[test]
    fn it_is_harmonic_between_the_values_and_zero_without_any() {
        let mesh = zoo::plane(40, 10);
        let topo = Topology::new(&mesh);
        assert!(material(&mesh, &topo, &[]).unwrap().iter().all(|&m| m == 0.0));
        let at = |x: f64, value| ScalarConstraint { at: vec3(x, 5.0, 0.0), value, radius: None };
        let m = material(&mesh, &topo, &[at(5.0, 0.0), at(35.0, 1.0)]).unwrap();
        let along: Vec<f32> = (5..=35).map(|x| m[5 * 41 + x]).collect();
        assert!(along.windows(2).all(|w| w[0] <= w[1]) && (along[0], along[30]) == (0.0, 1.0), "{along:?}");
        assert!((along[15] - 0.5).abs() < 0.02 && m.iter().all(|m| (0.0..=1.0).contains(m)), "{along:?}");
        let e = material(&mesh, &topo, &[at(5.0, 0.0), at(35.0, 1.5)]).unwrap_err();
        assert_eq!(e.to_string(), "material constraint 1: the value is 1.5; it must be in 0..=1");
    }

    #[test]
    fn noise_wanders_everywhere_and_smoothly() {
        let mesh = zoo::plane(100, 100);
        let m = wandering(&mesh, 10.0, 3);
        assert!((0..4).all(|q| m.iter().any(|m| (m * 4.0).min(3.0) as i32 == q)));
        assert!((0..100).all(|x| (m[x] - m[x + 1]).abs() < 0.35));
        assert_ne!(m, wandering(&mesh, 10.0, 4));
    }
}
