//! Small vectors of f64.

use std::ops::{Add, AddAssign, Div, Index, Mul, Neg, Sub, SubAssign};

/// A vector or point in space, f64.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Vec3 {
    /// First component.
    pub x: f64,
    /// Second component.
    pub y: f64,
    /// Third component.
    pub z: f64,
}

/// A vector or point in a plane, f64.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Vec2 {
    /// First component.
    pub x: f64,
    /// Second component.
    pub y: f64,
}

/// Builds a [`Vec3`].
pub const fn vec3(x: f64, y: f64, z: f64) -> Vec3 {
    Vec3 { x, y, z }
}

/// Builds a [`Vec2`].
pub const fn vec2(x: f64, y: f64) -> Vec2 {
    Vec2 { x, y }
}

impl Vec3 {
    /// The origin.
    pub const ZERO: Vec3 = vec3(0.0, 0.0, 0.0);

    /// Scalar product.
    pub fn dot(self, o: Vec3) -> f64 {
        self.x * o.x + self.y * o.y + self.z * o.z
    }

    /// Vector product, right-handed.
    pub fn cross(self, o: Vec3) -> Vec3 {
        vec3(self.y * o.z - self.z * o.y, self.z * o.x - self.x * o.z, self.x * o.y - self.y * o.x)
    }

    /// Euclidean length.
    pub fn length(self) -> f64 {
        self.dot(self).sqrt()
    }

    /// Unit vector of the same direction; `None` when the length is zero, subnormal or not finite.
    pub fn normalized(self) -> Option<Vec3> {
        let l = self.length();
        (l.is_normal()).then(|| self / l)
    }

    /// The part perpendicular to the unit vector `n`.
    pub fn reject(self, n: Vec3) -> Vec3 {
        self - n * self.dot(n)
    }

    /// Any unit vector perpendicular to the unit vector `self`; a fixed function of it.
    pub fn any_perpendicular(self) -> Vec3 {
        let a = if self.x.abs() <= self.y.abs() && self.x.abs() <= self.z.abs() {
            vec3(1.0, 0.0, 0.0)
        } else if self.y.abs() <= self.z.abs() {
            vec3(0.0, 1.0, 0.0)
        } else {
            vec3(0.0, 0.0, 1.0)
        };
        a.reject(self).normalized().unwrap_or(a)
    }

    /// True if no component is NaN or infinite.
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite()
    }

    /// Single-precision components.
    pub fn to_f32(self) -> [f32; 3] {
        [self.x as f32, self.y as f32, self.z as f32]
    }
}

impl From<[f32; 3]> for Vec3 {
    fn from(a: [f32; 3]) -> Self {
        vec3(f64::from(a[0]), f64::from(a[1]), f64::from(a[2]))
    }
}

impl From<[f64; 3]> for Vec3 {
    fn from(a: [f64; 3]) -> Self {
        vec3(a[0], a[1], a[2])
    }
}

impl From<Vec3> for [f64; 3] {
    fn from(v: Vec3) -> Self {
        [v.x, v.y, v.z]
    }
}

impl Index<usize> for Vec3 {
    type Output = f64;
    fn index(&self, i: usize) -> &f64 {
        match i {
            0 => &self.x,
            1 => &self.y,
            _ => &self.z,
        }
    }
}

impl Vec2 {
    /// The origin.
    pub const ZERO: Vec2 = vec2(0.0, 0.0);

    /// Scalar product.
    pub fn dot(self, o: Vec2) -> f64 {
        self.x * o.x + self.y * o.y
    }

    /// Signed area of the parallelogram of `self` and `o`.
    pub fn cross(self, o: Vec2) -> f64 {
        self.x * o.y - self.y * o.x
    }

    /// Euclidean length.
    pub fn length(self) -> f64 {
        self.dot(self).sqrt()
    }
}

macro_rules! ops {
    ($t:ident { $($c:ident),+ }) => {
        impl Add for $t { type Output = $t; fn add(self, o: $t) -> $t { $t { $($c: self.$c + o.$c),+ } } }
        impl Sub for $t { type Output = $t; fn sub(self, o: $t) -> $t { $t { $($c: self.$c - o.$c),+ } } }
        impl Mul<f64> for $t { type Output = $t; fn mul(self, s: f64) -> $t { $t { $($c: self.$c * s),+ } } }
        impl Div<f64> for $t { type Output = $t; fn div(self, s: f64) -> $t { $t { $($c: self.$c / s),+ } } }
        impl Neg for $t { type Output = $t; fn neg(self) -> $t { $t { $($c: -self.$c),+ } } }
        impl AddAssign for $t { fn add_assign(&mut self, o: $t) { *self = *self + o; } }
        impl SubAssign for $t { fn sub_assign(&mut self, o: $t) { *self = *self - o; } }
    };
}
ops!(Vec3 { x, y, z });
ops!(Vec2 { x, y });
