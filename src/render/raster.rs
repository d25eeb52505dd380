//! Visibility and shading of one view.
//!
//! With corners P0, P1, P2 in camera space and the ray r = (x, y, 1) of a sample, u_i = (P_j x P_k) . r are linear in x
//! and y; the barycentric coordinates of the hit are u_i / sum(u) and its depth is det(P0, P1, P2) / sum(u). So triangles
//! that cross the camera's plane need no clipping, and coordinates are perspective-correct as they are.

use crate::numerics::par;
use crate::numerics::vec::{Vec3, vec3};
use crate::texture::Texture;
use crate::texture::color::{linear_to_srgb, srgb_to_linear};

use super::light::{self, Directions};
use super::look::Hit;
use super::{Mode, Scene, View};

/// Samples along one side of a pixel.
const SAMPLES: u32 = 2;
/// Rows of pixels that are drawn as one piece of work.
const STRIP: u32 = 16;
/// Nothing nearer than this share of the distance to the target is drawn.
const NEAR: f64 = 1e-4;

/// A triangle ready for its samples: u_i as linear functions of the sample's position in the picture.
struct Tri {
    face: u32,
    /// u_i = a x + b y + c, x and y in samples.
    u: [[f64; 3]; 3],
    det: f64,
    /// Samples that it may cover: columns and rows, ends exclusive.
    columns: [u32; 2],
    rows: [u32; 2],
}

struct Camera {
    axes: [Vec3; 3],
    eye: Vec3,
    /// Half the picture's side at distance 1.
    half: f64,
    samples: f64,
    near: f64,
}

impl Camera {
    fn new(view: &View) -> Self {
        let samples = f64::from(view.size * SAMPLES);
        let half = crate::numerics::det::tan(view.fov * 0.5);
        let near = (view.target - view.eye).length() * NEAR;
        Camera { axes: view.axes(), eye: view.eye, half, samples, near }
    }

    /// Right, up, forward.
    fn to_camera(&self, p: Vec3) -> Vec3 {
        let d = p - self.eye;
        vec3(d.dot(self.axes[0]), d.dot(self.axes[1]), d.dot(self.axes[2]))
    }

    fn triangle(&self, face: u32, world: [Vec3; 3]) -> Option<Tri> {
        let p = world.map(|w| self.to_camera(w));
        let det = p[0].dot(p[1].cross(p[2]));
        if !det.is_normal() || p.iter().all(|p| p.z <= self.near) {
            return None;
        }
        // r = (half (2 x / n - 1), half (1 - 2 y / n), 1) at sample position (x, y).
        let s = 2.0 * self.half / self.samples;
        let u = [0, 1, 2].map(|i| {
            let e = p[(i + 1) % 3].cross(p[(i + 2) % 3]);
            [e.x * s, -e.y * s, e.z + (e.y - e.x) * self.half]
        });
        let (mut low, mut high) = ([0.0; 2], [self.samples; 2]);
        if p.iter().all(|p| p.z > self.near) {
            let at = p.map(|p| [(p.x / p.z / self.half + 1.0) * 0.5, (1.0 - p.y / p.z / self.half) * 0.5]);
            for k in 0..2 {
                let c = at.map(|a| a[k] * self.samples);
                low[k] = c[0].min(c[1]).min(c[2]).floor().clamp(0.0, self.samples);
                high[k] = (c[0].max(c[1]).max(c[2]).floor() + 1.0).clamp(0.0, self.samples);
            }
        }
        let range = |k: usize| [low[k] as u32, high[k] as u32];
        Some(Tri { face, u, det, columns: range(0), rows: range(1) })
    }
}

impl Tri {
    /// Barycentric coordinates and depth at a position, whether inside or not.
    fn at(&self, x: f64, y: f64) -> ([f64; 3], f64) {
        let u = self.u.map(|u| u[0] * x + u[1] * y + u[2]);
        let sum = u[0] + u[1] + u[2];
        (u.map(|v| v / sum), self.det / sum)
    }
}

/// Draws one view: linear RGB. Same bytes for any number of threads.
pub fn render(scene: &Scene<'_>, view: &View, mode: Mode) -> Texture {
    let camera = Camera::new(view);
    let faces = scene.mesh.faces.len();
    let triangles: Vec<Tri> =
        par::map(faces, |f| camera.triangle(f as u32, scene.mesh.corners(f))).into_iter().flatten().collect();
    let strip_rows = STRIP * SAMPLES;
    let mut bins: Vec<Vec<u32>> = vec![Vec::new(); (view.size.div_ceil(STRIP)) as usize];
    for (i, t) in triangles.iter().enumerate().filter(|(_, t)| t.rows[0] < t.rows[1]) {
        for strip in t.rows[0] / strip_rows..=(t.rows[1] - 1) / strip_rows {
            bins[strip as usize].push(i as u32);
        }
    }
    let mut out = Texture::new(view.size, view.size, 3);
    par::for_rows(out.data_mut(), (view.size * STRIP * 3) as usize, |strip, rows| {
        let painter = Painter { scene, camera: &camera, view, mode, first: strip as u32 * strip_rows };
        let hits = painter.visible(&triangles, &bins[strip], (rows.len() / (view.size as usize * 3)) as u32 * SAMPLES);
        for (i, pixel) in rows.chunks_exact_mut(3).enumerate() {
            painter.pixel(&triangles, &hits, i as u32 % view.size, i as u32 / view.size, pixel);
        }
    });
    out
}

struct Painter<'a> {
    scene: &'a Scene<'a>,
    camera: &'a Camera,
    view: &'a View,
    mode: Mode,
    /// First row of samples of the strip.
    first: u32,
}

/// No triangle at a sample.
const NOTHING: u32 = u32::MAX;

impl Painter<'_> {
    /// The nearest triangle at each sample of the strip; of equals the first.
    fn visible(&self, triangles: &[Tri], bin: &[u32], rows: u32) -> Vec<u32> {
        let width = self.view.size * SAMPLES;
        let mut hits = vec![NOTHING; (width * rows) as usize];
        let mut depths = vec![f64::INFINITY; hits.len()];
        for &i in bin {
            let t = &triangles[i as usize];
            for y in t.rows[0].max(self.first)..t.rows[1].min(self.first + rows) {
                for x in t.columns[0]..t.columns[1] {
                    let (bary, depth) = t.at(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let at = ((y - self.first) * width + x) as usize;
                    let inside = bary.iter().all(|b| *b >= 0.0) && depth > self.camera.near && depth < depths[at];
                    if inside && self.scene.look.is_there(t.face as usize, bary.map(|b| b as f32)) {
                        depths[at] = depth;
                        hits[at] = i;
                    }
                }
            }
        }
        hits
    }

    fn pixel(&self, triangles: &[Tri], hits: &[u32], x: u32, y: u32, out: &mut [f32]) {
        let mut sum = [0.0f32; 3];
        for j in 0..SAMPLES {
            for i in 0..SAMPLES {
                let (sx, sy) = (x * SAMPLES + i, y * SAMPLES + j);
                let color = match hits[(sy * self.view.size * SAMPLES + sx) as usize] {
                    NOTHING => self.background(y + self.first / SAMPLES),
                    hit => self.shade(&triangles[hit as usize], f64::from(sx) + 0.5, f64::from(sy + self.first) + 0.5),
                };
                (0..3).for_each(|k| sum[k] += color[k].min(1.0));
            }
        }
        let n = (SAMPLES * SAMPLES) as f32;
        out.copy_from_slice(&sum.map(|s| s / n));
    }

    /// A quiet gradient.
    fn background(&self, y: u32) -> [f32; 3] {
        let t = y as f32 / self.view.size as f32;
        [0.105 - 0.05 * t, 0.112 - 0.052 * t, 0.125 - 0.056 * t]
    }

    fn shade(&self, t: &Tri, x: f64, y: f64) -> [f32; 3] {
        let face = t.face as usize;
        let (bary, _) = t.at(x, y);
        let pixel = f64::from(SAMPLES);
        let (right, down) = (t.at(x + pixel, y).0, t.at(x, y + pixel).0);
        let grad = [1, 2].map(|k| [(right[k] - bary[k]) as f32, (down[k] - bary[k]) as f32]);
        let corners = self.scene.mesh.corners(face);
        let (mut point, mut normal) = (Vec3::ZERO, Vec3::ZERO);
        for i in 0..3 {
            point += corners[i] * bary[i];
            normal += self.scene.corner_normals[3 * face + i] * bary[i];
        }
        let to_eye = (self.camera.eye - point).normalized().unwrap_or(vec3(0.0, 0.0, 1.0));
        // A back is drawn as a front.
        let front = self.scene.mesh.area_vector(face).dot(to_eye) >= 0.0;
        let normal = normal.normalized().unwrap_or(to_eye) * if front { 1.0 } else { -1.0 };
        let bary = bary.map(|b| b as f32);
        let hit = Hit { face, bary, grad, normal: normal.to_f32(), front };
        match self.mode {
            Mode::Patches => self.ramp(face, bary),
            Mode::Uv => self.checker(face, bary),
            _ => {
                let a = self.scene.look.appearance(&hit);
                let [r, u, f] = self.camera.axes;
                let key = (r * -0.55 + u * 0.75 - f * 0.65).normalized().unwrap_or(u);
                match self.mode {
                    Mode::Lit => light::lit(&a, Directions { eye: to_eye.to_f32(), key: key.to_f32() }),
                    Mode::Normal => a.normal.map(|v| srgb_to_linear((v * 0.5 + 0.5).clamp(0.0, 1.0))),
                    _ => std::array::from_fn(|k| a.color[k] + a.emissive[k]),
                }
            }
        }
    }

    /// Position in the exemplar: right as red, down as green; a lit tint keeps the form readable.
    fn ramp(&self, face: usize, bary: [f32; 3]) -> [f32; 3] {
        match self.scene.look.source(face, bary) {
            Some([u, v]) => [u, v, 1.0 - 0.5 * (u + v)].map(|c| srgb_to_linear(c.clamp(0.0, 1.0))),
            None => [srgb_to_linear(0.5); 3],
        }
    }

    fn checker(&self, face: usize, bary: [f32; 3]) -> [f32; 3] {
        let (at, side) = self.scene.look.checker(face, bary);
        let odd = ((at.x / side).floor() as i64 + (at.y / side).floor() as i64).rem_euclid(2) == 1;
        let tint = srgb_to_linear(linear_to_srgb(if odd { 0.75 } else { 0.12 }));
        [tint, tint, tint * 0.9]
    }
}

#[cfg(test)]
mod tests {
    use super::super::look::{Appearance, Look};
    use super::*;
    use crate::mesh::TriMesh;
    use crate::texture::{Texel, texel};

    /// White where barycentric coordinate 0 exceeds a half.
    struct Split;

    impl Look for Split {
        fn appearance(&self, hit: &Hit) -> Appearance {
            Appearance {
                color: [if hit.bary[0] > 0.5 { 1.0 } else { 0.25 }; 3],
                normal: hit.normal,
                ..Appearance::default()
            }
        }
        fn is_there(&self, _: usize, _: [f32; 3]) -> bool {
            true
        }
        fn source(&self, _: usize, bary: [f32; 3]) -> Option<[f32; 2]> {
            Some([bary[1], bary[2]])
        }
        fn checker(&self, _: usize, _: [f32; 3]) -> (Texel, f32) {
            (texel(0.0, 0.0), 1.0)
        }
    }

    fn picture(positions: Vec<Vec3>, mode: Mode) -> Texture {
        let mesh = TriMesh { positions, faces: vec![[0, 1, 2]] };
        let normals = vec![vec3(0.0, 0.0, 1.0); 3];
        let scene = Scene { mesh: &mesh, corner_normals: &normals, look: &Split };
        let view = View { eye: vec3(0.0, 0.0, 4.0), target: Vec3::ZERO, fov: 1.0, size: 64 };
        render(&scene, &view, mode)
    }

    #[test]
    fn a_triangle_lands_where_it_should_and_the_background_stays() {
        let p = picture(vec![vec3(0.0, 1.5, 0.0), vec3(-1.5, -1.5, 0.0), vec3(1.5, -1.5, 0.0)], Mode::Unlit);
        assert_eq!(p.get(32, 12), [1.0; 3], "the upper corner is corner 0");
        assert_eq!(p.get(32, 50), [0.25; 3]);
        assert!(p.get(2, 2)[0] < 0.2, "background");
    }

    #[test]
    fn a_triangle_through_the_camera_is_drawn_without_clipping() {
        // One corner lies behind the eye; the visible part still covers the centre.
        let p = picture(vec![vec3(0.0, -0.5, 9.0), vec3(-3.0, -0.5, -3.0), vec3(3.0, -0.5, -3.0)], Mode::Unlit);
        assert!(p.get(32, 60)[0] >= 0.25, "the floor below the eye is seen");
        assert!(p.get(32, 4)[0] < 0.2, "nothing above");
        assert!(p.data().iter().all(|v| v.is_finite()));
    }

    #[test]
    fn pictures_do_not_depend_on_threads() {
        let draw = || picture(vec![vec3(0.0, 1.0, 0.5), vec3(-1.0, -1.0, 0.0), vec3(1.0, -1.0, -0.5)], Mode::Lit);
        assert_eq!(par::install(1, draw), par::install(8, draw));
    }
}
