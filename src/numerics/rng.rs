//! Random numbers addressed by key: (seed, purpose, element, draw). No state, no streams, no threads.
//!
//! Any element's numbers can be had without drawing those before it, so parallel and serial runs agree. Never use one
//! key for two purposes: name the purpose with [`Key::with_str`].

/// An address in the space of random numbers. Copy it, narrow it, draw from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key(u64);

/// Finaliser of SplitMix64 (Steele et al. 2014): a bijection with full avalanche.
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Key {
    /// The root key of a recipe's seed.
    pub fn new(seed: u64) -> Self {
        Key(mix(seed.wrapping_add(0x9e37_79b9_7f4a_7c15)))
    }

    /// The key of part `part` of this key: an element, a pass, a draw.
    pub fn with(self, part: u64) -> Self {
        Key(mix(self.0.rotate_left(17) ^ part.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x632b_e59b_d9b4_e019)))
    }

    /// The key of a named purpose.
    pub fn with_str(self, purpose: &str) -> Self {
        purpose.bytes().fold(self.with(purpose.len() as u64), |k, b| k.with(u64::from(b)))
    }

    /// 64 random bits: draw number `draw` of this key.
    pub fn bits(self, draw: u64) -> u64 {
        mix(self.with(draw).0)
    }

    /// Uniform in [0, 1), 53 random bits.
    pub fn unit(self, draw: u64) -> f64 {
        (self.bits(draw) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform in 0..n by multiply-shift. `n` must not be zero.
    pub fn below(self, draw: u64, n: u32) -> u32 {
        debug_assert!(n > 0, "an empty range has no element");
        (((self.bits(draw) >> 32) * u64::from(n)) >> 32) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_distinct_and_stable() {
        let k = Key::new(1);
        assert_ne!(k.bits(0), k.bits(1));
        assert_ne!(k.with(0).bits(0), k.with(1).bits(0));
        assert_ne!(k.with_str("walk").bits(0), k.with_str("klaw").bits(0));
        assert_eq!(Key::new(7).with(3).bits(2), Key::new(7).with(3).bits(2));
    }

    #[test]
    fn units_fill_the_interval_evenly() {
        let k = Key::new(42);
        let mut bins = [0u32; 10];
        for i in 0..10_000 {
            let u = k.unit(i);
            assert!((0.0..1.0).contains(&u));
            bins[(u * 10.0) as usize] += 1;
        }
        assert!(bins.iter().all(|&b| (850..1150).contains(&b)), "{bins:?}");
    }

    #[test]
    fn below_stays_below() {
        let k = Key::new(3);
        assert!((0..1000).all(|i| k.below(i, 7) < 7));
    }
}
