//! Where a picture is taken from.

use crate::mesh::TriMesh;
use crate::numerics::det;
use crate::numerics::vec::{Vec3, vec3};

/// A perspective camera of square pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Place of the eye.
    pub eye: Vec3,
    /// The point looked at; not the eye.
    pub target: Vec3,
    /// Field of view in radians, the same across and up.
    pub fov: f64,
    /// Side of the picture in pixels.
    pub size: u32,
}

impl View {
    /// Right, up and forward of the camera in the world; +y is up, or -z where the camera looks along y.
    pub fn axes(&self) -> [Vec3; 3] {
        let forward = (self.target - self.eye).normalized().unwrap_or(vec3(0.0, 0.0, -1.0));
        let up = if forward.y.abs() > 0.999 { vec3(0.0, 0.0, -1.0) } else { vec3(0.0, 1.0, 0.0) };
        let right = forward.cross(up).normalized().unwrap_or(vec3(1.0, 0.0, 0.0));
        [right, right.cross(forward), forward]
    }
}

/// Elevation of a turntable's camera and the first view's azimuth, in degrees.
const ELEVATION_DEG: f64 = 20.0;
const FIRST_DEG: f64 = 25.0;
const FOV_DEG: f64 = 32.0;

/// `n` views around a mesh, evenly spread, from a little above; all of it is in the picture.
pub fn turntable(mesh: &TriMesh, n: u32, size: u32) -> Vec<View> {
    let (low, high) = mesh.bounds();
    let target = (low + high) * 0.5;
    let radius = mesh.positions.iter().fold(f64::MIN_POSITIVE, |r, p| r.max((*p - target).length()));
    let fov = FOV_DEG.to_radians();
    let distance = radius / det::sin(fov * 0.5);
    let (lift, flat) = det::sin_cos(ELEVATION_DEG.to_radians());
    (0..n)
        .map(|i| {
            let (s, c) = det::sin_cos(FIRST_DEG.to_radians() + std::f64::consts::TAU * f64::from(i) / f64::from(n));
            View { eye: target + vec3(s * flat, lift, c * flat) * distance, target, fov, size }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_vertex_is_in_every_picture() {
        let positions = vec![vec3(5.0, 0.0, 0.0), vec3(6.0, 3.0, 1.0), vec3(5.0, -1.0, 2.0)];
        let mesh = TriMesh { positions, faces: vec![[0, 1, 2]] };
        for view in turntable(&mesh, 5, 64) {
            let [right, up, forward] = view.axes();
            let half = det::tan(view.fov * 0.5) * (1.0 + 1e-9);
            for p in &mesh.positions {
                let d = *p - view.eye;
                let depth = d.dot(forward);
                assert!((d.dot(right) / depth).abs() <= half && (d.dot(up) / depth).abs() <= half, "{view:?}");
            }
        }
    }
}
