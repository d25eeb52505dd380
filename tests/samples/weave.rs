//! Woven cloth: a dense twill of two colours, and open burlap with holes.

use kiln::numerics::det;
use kiln::numerics::rng::Key;

use crate::material::{Extra, Material, Point};
use crate::noise::{fractal, hash, mix, mix3, rgb, shade};

/// One thread at a point: its height above the cloth's middle and how far from its axis (0 axis, 1 edge).
struct Thread {
    height: f64,
    across: f64,
    index: i64,
}

/// The thread along one axis. `a` runs across threads, `b` along them, both in thread widths; `over` says whether it
/// lies above at a crossing.
fn thread(key: Key, a: f64, b: f64, width: f64, over: impl Fn(i64, i64) -> bool) -> Thread {
    let sway = 0.10 * fractal(key, b * 0.5, a.floor() * 7.3, 2);
    let a = a + sway;
    let index = a.floor() as i64;
    let across = ((a - a.floor() - 0.5) * 2.0 / width).abs();
    // Height along the thread: a smooth wave through the crossings.
    let (b0, t) = (b.floor() as i64, b - b.floor() - 0.5);
    let level = |j: i64| if over(index, j) { 1.0 } else { -1.0 };
    let next = if t > 0.0 { level(b0 + 1) } else { level(b0 - 1) };
    let s = (1.0 - det::cos(t.abs() * std::f64::consts::PI)) * 0.5;
    let wave = mix(level(b0), next, s);
    let round = (1.0 - across * across).max(0.0).sqrt();
    Thread { height: 0.34 * wave + 0.40 * round, across, index }
}

struct Cloth {
    key: Key,
    period: f64,
    width: f64,
    warp: [f64; 3],
    weft: [f64; 3],
    twill: bool,
}

impl Cloth {
    fn at(&self, x: f64, y: f64) -> Point {
        let key = self.key;
        let drift = 0.06 * fractal(key.with(1), x / 40.0, y / 40.0, 2);
        let (u, v) = (x / self.period + drift, y / self.period - drift);
        let twill = self.twill;
        let up = move |i: i64, j: i64| if twill { (i + j).rem_euclid(4) < 2 } else { (i + j).rem_euclid(2) == 0 };
        let warp = thread(key.with(2), u, v, self.width, up);
        let weft = thread(key.with(3), v, u, self.width, |j, i| !up(i, j));
        let (warp_in, weft_in) = (warp.across < 1.0, weft.across < 1.0);
        let hole = !warp_in && !weft_in;
        let is_warp = warp_in && (!weft_in || warp.height >= weft.height);
        let (t, base, along, side, k) =
            if is_warp { (&warp, self.warp, v, u, key.with(4)) } else { (&weft, self.weft, u, v, key.with(5)) };
        // Twisted fibres: fine diagonal strands along the thread.
        let twist = det::sin((side * 5.0 + along * 1.6) * std::f64::consts::TAU);
        let fluff = fractal(k.with(1), side * 14.0, along * 3.0, 3);
        let own = hash(k, t.index, 0) - 0.5;
        let slub = fractal(k.with(2), along * 0.8, t.index as f64 * 3.1, 2);
        let lit = (0.90 + 0.10 * twist + 0.20 * fluff + 0.22 * own + 0.12 * slub)
            * mix(1.06, 0.50, t.across.min(1.0).powi2());
        let height = if hole { 0.0 } else { (0.42 + 0.5 * t.height + 0.03 * twist + 0.03 * fluff).clamp(0.0, 1.0) };
        let deep = mix(0.62, 1.05, ((t.height + 0.34) / 1.08).clamp(0.0, 1.0));
        Point {
            color: if hole { shade(base, 0.25) } else { shade(base, lit * deep) },
            height,
            roughness: (0.88 + 0.08 * fluff).clamp(0.0, 1.0),
            opacity: if hole { 0.0 } else { 1.0 },
            ..Point::default()
        }
    }
}

trait Square {
    fn powi2(self) -> f64;
}

impl Square for f64 {
    fn powi2(self) -> f64 {
        self * self
    }
}

pub fn twill() -> Material {
    let key = Key::new(21).with_str("twill");
    let cloth = Cloth { key, period: 10.0, width: 0.98, warp: rgb(0x39557a), weft: rgb(0xcfc7b4), twill: true };
    Material::new(256, 256, 5.0, Extra::default(), |x, y| {
        let p = cloth.at(x, y);
        let worn = fractal(key.with(9), x / 50.0, y / 50.0, 3);
        Point { color: mix3(p.color, rgb(0x8d8f92), (0.12 * worn).max(0.0)), ..p }
    })
}

pub fn burlap() -> Material {
    let key = Key::new(22).with_str("burlap");
    let cloth = Cloth { key, period: 16.0, width: 0.74, warp: rgb(0xa98552), weft: rgb(0xb8965f), twill: false };
    let extra = Extra { opacity: true, ..Extra::default() };
    Material::new(192, 192, 7.0, extra, |x, y| cloth.at(x, y))
}
