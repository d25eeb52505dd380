//! Transcendental functions with the same bits on every machine.
//!
//! std's are the platform's and differ between C libraries; libm's are plain Rust arithmetic. `sqrt`, `floor`, `abs`
//! are exact in std and may be used directly. `clippy.toml` bans the std names of everything below.

/// Sine of an angle in radians.
pub fn sin(x: f64) -> f64 {
    libm::sin(x)
}

/// Cosine of an angle in radians.
pub fn cos(x: f64) -> f64 {
    libm::cos(x)
}

/// Sine and cosine of an angle in radians.
pub fn sin_cos(x: f64) -> (f64, f64) {
    (libm::sin(x), libm::cos(x))
}

/// Tangent of an angle in radians.
pub fn tan(x: f64) -> f64 {
    libm::tan(x)
}

/// Arc cosine in radians; the argument is clamped to -1..=1, so rounding never makes a NaN.
pub fn acos(x: f64) -> f64 {
    libm::acos(x.clamp(-1.0, 1.0))
}

/// Angle of the vector (x, y) in radians, in -pi..=pi.
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// e to the power of x.
pub fn exp(x: f64) -> f64 {
    libm::exp(x)
}

/// Natural logarithm.
pub fn ln(x: f64) -> f64 {
    libm::log(x)
}

/// Logarithm to base two.
pub fn log2(x: f64) -> f64 {
    libm::log2(x)
}

/// x to the power of y.
pub fn pow(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

/// Single-precision cube root, of the sign of x.
pub fn cbrt(x: f32) -> f32 {
    libm::cbrtf(x)
}

/// Single-precision x to the power of y.
pub fn powf(x: f32, y: f32) -> f32 {
    libm::powf(x, y)
}

/// Single-precision e to the power of x.
pub fn expf(x: f32) -> f32 {
    libm::expf(x)
}
