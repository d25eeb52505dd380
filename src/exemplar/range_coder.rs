//! An adaptive binary range coder.
//!
//! Source: Martin: Range encoding (1979); the adaptive bits and the carry are those of LZMA (Pavlov). Integers only.
//! What is coded is written once, as a walk that hands every bit to a [`Coder`]: the encoder takes the bit it is given,
//! the decoder ignores it and answers with the bit that it finds, so that the two cannot drift apart.
//! Unaware of: what the bits mean.

/// Probability of a zero, of 4096. Moves towards what comes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chance(u16);

impl Chance {
    pub(super) const EVEN: Chance = Chance(2048);

    /// The part of a range for a zero. At least 31/4096, so a bit costs at least 0.01 bits.
    fn bound(self, range: u32) -> u32 {
        (range >> 12) * u32::from(self.0)
    }

    fn learn(&mut self, bit: bool) {
        if bit {
            self.0 -= self.0 >> 5;
        } else {
            self.0 += (4096 - self.0) >> 5;
        }
    }
}

/// Encoder or decoder.
pub(super) trait Coder {
    /// Codes one bit by its chance.
    fn bit(&mut self, chance: &mut Chance, bit: bool) -> bool;

    /// Codes the lowest bits of a value, each even.
    fn raw(&mut self, value: u32, bits: u32) -> u32;

    /// Codes a byte bit by bit, highest first, by the chances of a tree.
    fn byte(&mut self, tree: &mut [Chance; 256], value: u8) -> u8 {
        let mut node = 1usize;
        for i in (0..8).rev() {
            node = node << 1 | usize::from(self.bit(&mut tree[node], value >> i & 1 == 1));
        }
        node as u8
    }
}

/// Writes bits to bytes.
pub(super) struct Encoder {
    low: u64,
    range: u32,
    /// The last byte and how many 0xff came after it: a carry may still change them.
    held: u8,
    pending: usize,
    out: Vec<u8>,
}

impl Encoder {
    pub(super) fn new() -> Self {
        Encoder { low: 0, range: u32::MAX, held: 0, pending: 0, out: vec![] }
    }

    /// The bytes, at least five.
    pub(super) fn finish(mut self) -> Vec<u8> {
        (0..5).for_each(|_| self.shift());
        self.out
    }

    fn shift(&mut self) {
        if self.low < 0xff00_0000 || self.low > 0xffff_ffff {
            let carry = (self.low >> 32) as u8;
            // The very first byte is always zero and carries nothing: it is written, for simplicity's sake.
            self.out.push(self.held.wrapping_add(carry));
            self.out.extend(std::iter::repeat_n(0xffu8.wrapping_add(carry), self.pending));
            (self.held, self.pending) = ((self.low >> 24) as u8, 0);
        } else {
            self.pending += 1;
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    fn normalise(&mut self) {
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.shift();
        }
    }
}

impl Coder for Encoder {
    fn bit(&mut self, chance: &mut Chance, bit: bool) -> bool {
        let bound = chance.bound(self.range);
        if bit {
            self.low += u64::from(bound);
            self.range -= bound;
        } else {
            self.range = bound;
        }
        chance.learn(bit);
        self.normalise();
        bit
    }

    fn raw(&mut self, value: u32, bits: u32) -> u32 {
        for i in (0..bits).rev() {
            self.range >>= 1;
            if value >> i & 1 == 1 {
                self.low += u64::from(self.range);
            }
            self.normalise();
        }
        value
    }
}

/// Reads bits from bytes; zeros follow after their end.
pub(super) struct Decoder<'a> {
    bytes: &'a [u8],
    code: u32,
    range: u32,
}

impl<'a> Decoder<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Decoder { bytes, code: 0, range: u32::MAX };
        (0..5).for_each(|_| decoder.next());
        decoder
    }

    fn next(&mut self) {
        let (byte, rest) = self.bytes.split_first().map_or((0, self.bytes), |(b, rest)| (*b, rest));
        self.bytes = rest;
        self.code = self.code << 8 | u32::from(byte);
    }

    fn normalise(&mut self) {
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.next();
        }
    }
}

impl Coder for Decoder<'_> {
    fn bit(&mut self, chance: &mut Chance, _: bool) -> bool {
        let bound = chance.bound(self.range);
        let bit = self.code >= bound;
        if bit {
            self.code -= bound;
            self.range -= bound;
        } else {
            self.range = bound;
        }
        chance.learn(bit);
        self.normalise();
        bit
    }

    fn raw(&mut self, _: u32, bits: u32) -> u32 {
        (0..bits).fold(0, |value, _| {
            self.range >>= 1;
            let bit = self.code >= self.range;
            if bit {
                self.code -= self.range;
            }
            self.normalise();
            value << 1 | u32::from(bit)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Codes bytes by a tree of chances, each followed by as many raw bits as its lowest five say.
    fn walk(coder: &mut impl Coder, given: &[(u8, u32)], len: usize) -> Vec<(u8, u32)> {
        let mut tree = [Chance::EVEN; 256];
        (0..len)
            .map(|i| {
                let (byte, raw) = given.get(i).copied().unwrap_or_default();
                let byte = coder.byte(&mut tree, byte);
                (byte, coder.raw(raw, u32::from(byte & 31)))
            })
            .collect()
    }

    proptest! {
        #[test]
        fn what_goes_in_comes_out(bytes in proptest::collection::vec((any::<u8>(), any::<u32>()), 0..300)) {
            let given: Vec<_> = bytes.iter().map(|(b, r)| (*b, r & ((1u32 << (b & 31)) - 1))).collect();
            let mut encoder = Encoder::new();
            walk(&mut encoder, &given, given.len());
            let bytes = encoder.finish();
            prop_assert_eq!(walk(&mut Decoder::new(&bytes), &[], given.len()), given);
        }
    }

    #[test]
    fn long_runs_and_carries_survive() {
        // Improbable ones after many zeros push the lower bound up to where it carries.
        let bit = |i: u32| i % 97 == 96 || i % 1013 > 1000;
        let mut encoder = Encoder::new();
        let mut chance = Chance::EVEN;
        (0..100_000).for_each(|i| {
            encoder.bit(&mut chance, bit(i));
        });
        let bytes = encoder.finish();
        assert!(bytes.len() < 100_000 / 8 / 4, "{}", bytes.len());
        let mut decoder = Decoder::new(&bytes);
        let mut chance = Chance::EVEN;
        assert!((0..100_000).all(|i| decoder.bit(&mut chance, false) == bit(i)));
    }
}
