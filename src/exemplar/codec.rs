//! The jump map as bytes, for the cache.
//!
//! Layout: "KJM2", checksum of the rest (u64, FNV-1a), width, height, number of jumps (u32 each, little endian), whether
//! it wraps and whether it is masked (u8 each), the different probabilities (u16 number, then each times 65536 less one,
//! falling), and a range-coded stream: which texels belong, row by row, then for each of these its number of jumps and
//! its jumps.
//! A texel's matches mostly move along with those of the texel on its left or above (59 % at k = 3 on photographs, 32 %
//! on the left), so a jump is first looked for there, and if so costs 2 bits in place of 16; its probability is coded as
//! the difference from that of the jump it continues. Measured at k = 3 on leopard, granite and water: 1.5 to 1.8 bytes a
//! jump, 4.6 to 5.4 a texel; five bytes a jump and one a texel would be 16.
//! More than 256 different probabilities are rounded down to so many; `analyse` makes fewer.
//! Unaware of: files, the cache.

use super::range_coder::{Chance, Coder, Decoder, Encoder};
use super::{Domain, Error, Jump, JumpMap};
use crate::texture::Wrap;

/// The first bytes of a stored jump map.
pub const JUMP_MAP_MAGIC: &[u8; 4] = b"KJM2";
const HEADER: usize = 28;
const STEPS: f32 = 65536.0;
/// A byte cannot hold more than this many texels or jumps: each is at least one bit of at least 0.01.
const MAX_RATIO: u64 = 1024;
/// Jumps of a neighbour that a jump may continue.
const CONTINUED: usize = 8;

impl JumpMap {
    /// The map in a compact form that [`JumpMap::from_bytes`] reads.
    pub fn to_bytes(&self) -> Vec<u8> {
        let (counts, jumps) = self.parts();
        let counts: Vec<u8> = counts.collect();
        let palette = Palette::of(jumps);
        let mut given = jumps.iter().map(|j| Link { to: [j.x, j.y], level: palette.level(steps(j.p)) });
        let mut encoder = Encoder::new();
        let masked = self.domain().bits().is_some();
        let domain = code_domain(&mut encoder, self.domain(), masked).unwrap_or_else(|| self.domain().clone());
        code_links(&mut encoder, &domain, &counts, &mut given);

        let mut rest = Vec::new();
        for n in [self.width(), self.height(), jumps.len() as u32] {
            rest.extend_from_slice(&n.to_le_bytes());
        }
        rest.push(u8::from(domain.wrap() == Wrap::Repeat));
        rest.push(u8::from(masked));
        rest.extend_from_slice(&(palette.0.len() as u16).to_le_bytes());
        rest.extend(palette.0.iter().flat_map(|p| ((p - 1) as u16).to_le_bytes()));
        rest.extend(encoder.finish());
        let mut out = JUMP_MAP_MAGIC.to_vec();
        out.extend_from_slice(&checksum(&rest).to_le_bytes());
        out.extend(rest);
        out
    }

    /// Width, height and number of jumps of what [`JumpMap::to_bytes`] wrote, from its head alone.
    pub fn counts(bytes: &[u8]) -> Result<[u32; 3], Error> {
        let header = bytes.first_chunk::<HEADER>().filter(|h| h.starts_with(JUMP_MAP_MAGIC));
        let header = header.ok_or(Error::Damaged("no KJM2 mark"))?;
        Ok([12, 16, 20].map(|i| u32::from_le_bytes([header[i], header[i + 1], header[i + 2], header[i + 3]])))
    }

    /// Reads what [`JumpMap::to_bytes`] wrote. Anything else, or a damaged map, is [`Error::Damaged`].
    pub fn from_bytes(bytes: &[u8]) -> Result<JumpMap, Error> {
        let damaged = |holds: bool, what| if holds { Ok(()) } else { Err(Error::Damaged(what)) };
        let (header, rest) = bytes.split_at_checked(HEADER).ok_or(Error::Damaged("too short for a header"))?;
        damaged(&header[..4] == JUMP_MAP_MAGIC, "no KJM2 mark")?;
        let word = |i: usize| u32::from_le_bytes([header[i], header[i + 1], header[i + 2], header[i + 3]]);
        let sum = (u64::from(word(8)) << 32) | u64::from(word(4));
        damaged(sum == checksum(&bytes[12..]), "the checksum differs")?;
        let (width, height, count) = (word(12), word(16), word(20));
        damaged([width, height].iter().all(|s| (1..=65535).contains(s)), "a side is 0 or above 65535")?;
        let wrap = match header[24] {
            0 => Wrap::Clamp,
            1 => Wrap::Repeat,
            _ => return Err(Error::Damaged("unknown flags")),
        };
        damaged(header[25] <= 1, "unknown flags")?;
        let probabilities = usize::from(u16::from_le_bytes([header[26], header[27]]));
        damaged(probabilities <= 256, "more than 256 probabilities")?;
        let (palette, stream) = rest.split_at_checked(2 * probabilities).ok_or(Error::Damaged("too short"))?;
        let (pairs, _) = palette.as_chunks::<2>();
        let palette: Vec<u32> = pairs.iter().map(|p| u32::from(u16::from_le_bytes(*p)) + 1).collect();
        let most = (u64::from(width) * u64::from(height)).max(count.into());
        damaged(most <= MAX_RATIO * stream.len() as u64, "too short for its size")?;

        let mut decoder = Decoder::new(stream);
        let full = Domain::full(width, height, wrap);
        let domain = code_domain(&mut decoder, &full, header[25] == 1).ok_or(Error::Damaged("no texel belongs"))?;
        let links = Links::read(&mut decoder, &domain, count as usize)?;
        let jump = |link: &Link| {
            let p = palette.get(usize::from(link.level)).ok_or(Error::Damaged("an unknown probability"))?;
            Ok(Jump { x: link.to[0], y: link.to[1], p: *p as f32 / STEPS })
        };
        let jumps = links.all.iter().map(jump).collect::<Result<_, _>>()?;
        Ok(JumpMap::from_counts(domain, &links.counts, jumps))
    }
}

/// A probability in steps of 2^-16.
fn steps(p: f32) -> u32 {
    (p * STEPS).floor().clamp(1.0, STEPS) as u32
}

/// The different probabilities of a map in steps of 2^-16, falling, at most 256.
struct Palette(Vec<u32>);

impl Palette {
    fn of(jumps: &[Jump]) -> Self {
        let mut all: Vec<u32> = jumps.iter().map(|j| steps(j.p)).collect();
        all.sort_unstable_by(|a, b| b.cmp(a));
        all.dedup();
        if all.len() > 256 {
            let (top, least) = (u64::from(all[0]), all[all.len() - 1]);
            all = (2..=256).rev().map(|m| ((top * m / 256) as u32).max(least)).chain([least]).collect();
            all.dedup();
        }
        Palette(all)
    }

    /// The largest that is not above `p`.
    fn level(&self, p: u32) -> u8 {
        self.0.partition_point(|q| *q > p).min(self.0.len() - 1) as u8
    }
}

/// Codes which texels belong: nothing if all do. `None` if none does.
fn code_domain(coder: &mut impl Coder, given: &Domain, masked: bool) -> Option<Domain> {
    if !masked {
        return Some(given.clone());
    }
    let mut chances = [Chance::EVEN; 4];
    // Whether each texel of the last row belonged; the texel on the left is the one before in this row.
    let mut above = vec![false; given.width() as usize];
    Domain::masked(given.width(), given.height(), given.wrap(), |x, y| {
        let left = x > 0 && above[x as usize - 1];
        let context = 2 * usize::from(above[x as usize]) + usize::from(left);
        let bit = coder.bit(&mut chances[context], given.contains(x as i32, y as i32));
        above[x as usize] = bit;
        bit
    })
}

/// A jump: destination and number of its probability.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Link {
    to: [u16; 2],
    level: u8,
}

/// Hands all jumps to an encoder. `counts` are of all texels of the rectangle.
fn code_links(coder: &mut impl Coder, domain: &Domain, counts: &[u8], given: &mut impl Iterator<Item = Link>) {
    let (mut links, mut model) = (Links::new(domain), Model::new(domain));
    for (i, &count) in counts.iter().enumerate() {
        let [x, y] = [(i % domain.width() as usize) as u16, (i / domain.width() as usize) as u16];
        if domain.contains(x.into(), y.into()) {
            let row: Vec<Link> = given.take(count.into()).collect();
            // What is given lies in the domain.
            let _ = model.row(coder, domain, &mut links, [x, y], &row);
        }
        links.starts.push(links.all.len() as u32);
    }
}

/// The jumps of the texels so far.
struct Links {
    /// Where the jumps of each texel of the rectangle begin.
    starts: Vec<u32>,
    /// The number of jumps of each texel of the domain.
    counts: Vec<u8>,
    all: Vec<Link>,
}

impl Links {
    fn new(domain: &Domain) -> Self {
        let texels = domain.width() as usize * domain.height() as usize;
        let mut starts = Vec::with_capacity(texels + 1);
        starts.push(0);
        Links { starts, counts: Vec::with_capacity(domain.len()), all: vec![] }
    }

    /// Takes all jumps from a decoder; there must be `count`.
    fn read(coder: &mut impl Coder, domain: &Domain, count: usize) -> Result<Self, Error> {
        let (mut links, mut model) = (Links::new(domain), Model::new(domain));
        for (y, x) in (0..domain.height()).flat_map(|y| (0..domain.width()).map(move |x| (y, x))) {
            if domain.contains(x as i32, y as i32) {
                model.row(coder, domain, &mut links, [x as u16, y as u16], &[])?;
                if links.all.len() > count {
                    return Err(Error::Damaged("the jumps do not add up"));
                }
            }
            links.starts.push(links.all.len() as u32);
        }
        if links.all.len() == count { Ok(links) } else { Err(Error::Damaged("the jumps do not add up")) }
    }

    /// The jumps of a texel that was coded.
    fn row(&self, x: u32, y: u32, width: u32) -> &[Link] {
        let i = y as usize * width as usize + x as usize;
        &self.all[self.starts[i] as usize..self.starts[i + 1] as usize]
    }
}

/// Chances of everything that is coded of a row.
struct Model {
    same_count: Chance,
    count: [Chance; 256],
    /// Whether a jump continues none; by its number in the row and by how many it could continue.
    fresh: [[Chance; 8]; 4],
    /// Whether it is this one that it continues; by its number and the candidate's.
    taken: [[Chance; 16]; 4],
    /// Levels less those continued, less that of the jump before, and first ones less the first of the texel before.
    level: [Box<[Chance; 256]>; 3],
    /// Bits of columns and rows.
    bits: [u32; 2],
    candidates: Vec<Link>,
    last_count: u8,
    last_level: u8,
}

impl Model {
    fn new(domain: &Domain) -> Self {
        Model {
            same_count: Chance::EVEN,
            count: [Chance::EVEN; 256],
            fresh: [[Chance::EVEN; 8]; 4],
            taken: [[Chance::EVEN; 16]; 4],
            level: std::array::from_fn(|_| Box::new([Chance::EVEN; 256])),
            bits: [domain.width(), domain.height()].map(|n| (n - 1).checked_ilog2().map_or(0, |b| b + 1)),
            candidates: vec![],
            last_count: 0,
            last_level: 0,
        }
    }

    /// Codes the jumps of a texel and appends them.
    fn row(
        &mut self,
        coder: &mut impl Coder,
        domain: &Domain,
        links: &mut Links,
        at: [u16; 2],
        given: &[Link],
    ) -> Result<(), Error> {
        let want = given.len() as u8;
        if coder.bit(&mut self.same_count, want != self.last_count) {
            self.last_count = coder.byte(&mut self.count, want);
        }
        links.counts.push(self.last_count);
        self.collect(domain, links, at);
        for number in 0..usize::from(self.last_count) {
            let link = self.jump(coder, number, given.get(number).copied().unwrap_or_default());
            if !domain.contains(link.to[0].into(), link.to[1].into()) {
                return Err(Error::Damaged("a jump leads out of the exemplar"));
            }
            links.all.push(link);
        }
        Ok(())
    }

    /// The jumps that those of a texel may continue: those of the texels on the left and above, moved along, likelier
    /// ones first.
    fn collect(&mut self, domain: &Domain, links: &Links, [x, y]: [u16; 2]) {
        self.candidates.clear();
        for (dx, dy) in [(1i32, 0i32), (0, 1), (-1, 1), (1, 1)] {
            let (fx, fy) = (i32::from(x) - dx, i32::from(y) - dy);
            if !domain.contains(fx, fy) {
                continue;
            }
            for link in links.row(fx as u32, fy as u32, domain.width()).iter().take(CONTINUED) {
                let to = domain.at(i32::from(link.to[0]) + dx, i32::from(link.to[1]) + dy);
                if let Some(to) = to.filter(|to| self.candidates.iter().all(|c| c.to != *to)) {
                    self.candidates.push(Link { to, level: link.level });
                }
            }
        }
        self.candidates.sort_by_key(|c| c.level);
    }

    /// Codes one jump.
    fn jump(&mut self, coder: &mut impl Coder, number: usize, want: Link) -> Link {
        let rank = number.min(3);
        let found = self.candidates.iter().position(|c| c.to == want.to);
        let many = self.candidates.len();
        let fresh = many == 0 || coder.bit(&mut self.fresh[rank][many.min(7)], found.is_none());
        let before = self.last_level;
        let link = if fresh {
            let to = [0, 1].map(|i| coder.raw(want.to[i].into(), self.bits[i]) as u16);
            let tree = &mut self.level[if number == 0 { 2 } else { 1 }];
            Link { to, level: coder.byte(tree, want.level.wrapping_sub(before)).wrapping_add(before) }
        } else {
            let mut i = 0;
            while i + 1 < many && !coder.bit(&mut self.taken[rank][i.min(15)], found == Some(i)) {
                i += 1;
            }
            let Link { to, level } = self.candidates.remove(i);
            Link { to, level: coder.byte(&mut self.level[0], want.level.wrapping_sub(level)).wrapping_add(level) }
        };
        self.last_level = link.level;
        link
    }
}

/// FNV-1a.
fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rng::Key;
    use proptest::prelude::*;

    fn small() -> JumpMap {
        let mut rows = vec![vec![]; 6];
        rows[0] = vec![Jump { x: 2, y: 1, p: 0.5 }, Jump { x: 1, y: 0, p: 1.0 / 65536.0 }];
        rows[5] = vec![Jump { x: 0, y: 0, p: 1.0 }];
        JumpMap::from_rows(3, 2, &rows)
    }

    /// A map of rows of 0 to 4 jumps, some of which move along with those of the texel on the left.
    fn random(domain: Domain, levels: u32, seed: u64) -> JumpMap {
        let key = Key::new(seed);
        let texels: Vec<[u16; 2]> = domain.texels().collect();
        let mut rows: Vec<Vec<Jump>> = vec![];
        for i in 0..domain.width() * domain.height() {
            let (x, y) = ((i % domain.width()) as i32, (i / domain.width()) as i32);
            let key = key.with(i.into());
            let jump = |n: u64| {
                let [x, y] = texels[key.below(3 * n, texels.len() as u32) as usize];
                Jump { x, y, p: (1 + key.below(3 * n + 1, levels)) as f32 / 65536.0 }
            };
            let mut row: Vec<Jump> = (0..key.below(0, 5)).map(|n| jump(n.into())).collect();
            if let Some(left) = rows.last().and_then(|r| r.first()).filter(|_| key.below(1, 2) == 1)
                && let Some([x, y]) = domain.at(i32::from(left.x) + 1, left.y.into())
            {
                row.push(Jump { x, y, p: left.p });
            }
            rows.push(if domain.contains(x, y) { row } else { vec![] });
        }
        JumpMap::over(domain, &rows)
    }

    #[test]
    fn survives_the_round_trip() {
        let map = small();
        assert_eq!(JumpMap::counts(&map.to_bytes()), Ok([3, 2, 3]));
        assert!(JumpMap::counts(b"KJM2").is_err());
        assert_eq!(JumpMap::from_bytes(&map.to_bytes()), Ok(map));
        let empty = JumpMap::from_rows(2, 2, &vec![vec![]; 4]);
        assert_eq!(JumpMap::from_bytes(&empty.to_bytes()), Ok(empty));
        for (seed, wrap) in [(1, Wrap::Clamp), (2, Wrap::Repeat)] {
            let domain = Domain::masked(23, 17, wrap, |x, y| (x / 5 + y / 3) % 4 > 0).unwrap();
            for domain in [domain, Domain::full(9, 31, wrap), Domain::full(1, 1, wrap)] {
                let map = random(domain, 200, seed);
                assert!(JumpMap::from_bytes(&map.to_bytes()).unwrap() == map);
            }
        }
    }

    #[test]
    fn too_many_probabilities_are_rounded_down() {
        let map = random(Domain::full(40, 40, Wrap::Clamp), 60_000, 5);
        let read = JumpMap::from_bytes(&map.to_bytes()).unwrap();
        let (was, is) = (map.parts().1, read.parts().1);
        assert!(was.iter().zip(is).all(|(a, b)| (a.x, a.y) == (b.x, b.y) && (0.0..0.0075).contains(&(a.p - b.p))));
        assert!(JumpMap::from_bytes(&read.to_bytes()).unwrap() == read);
        let map = JumpMap::from_rows(1, 1, &[vec![Jump { x: 0, y: 0, p: 0.4 }]]);
        let p = JumpMap::from_bytes(&map.to_bytes()).unwrap().row(0, 0)[0].p;
        assert_eq!(p, 26214.0 / 65536.0);
    }

    /// Bytes with a changed field, or another stream, under a right checksum.
    fn forged(mut bytes: Vec<u8>, field: usize, value: u32) -> Vec<u8> {
        bytes[field..field + 4].copy_from_slice(&value.to_le_bytes());
        let sum = checksum(&bytes[12..]);
        bytes[4..12].copy_from_slice(&sum.to_le_bytes());
        bytes
    }

    #[test]
    fn damage_is_named() {
        let fault = |bytes: &[u8]| match JumpMap::from_bytes(bytes) {
            Err(Error::Damaged(what)) => what,
            other => panic!("{other:?}"),
        };
        let whole = || small().to_bytes();
        assert_eq!(fault(&[]), "too short for a header");
        assert_eq!(fault(&[0; 40]), "no KJM2 mark");
        assert_eq!(fault(&forged(whole(), 12, 0)), "a side is 0 or above 65535");
        assert_eq!(fault(&forged(whole(), 12, 65536)), "a side is 0 or above 65535");
        assert_eq!(fault(&forged(whole(), 12, 65535)), "too short for its size");
        assert_eq!(fault(&forged(whole(), 20, u32::MAX)), "too short for its size");
        assert_eq!(fault(&forged(whole(), 20, 4)), "the jumps do not add up");
        assert_eq!(fault(&forged(whole(), 24, 0x0003_0002)), "unknown flags");
        assert_eq!(fault(&forged(whole(), 24, 0xffff_0000)), "more than 256 probabilities");
        assert_eq!(fault(&forged(whole(), 24, 0x0100_0000)), "too short");
        let mut fewer = whole();
        fewer.drain(28..32);
        assert_eq!(fault(&forged(fewer, 24, 0x0001_0000)), "an unknown probability");
        // Two columns need one bit less per jump than three, and one of them then leads nowhere.
        let wide = random(Domain::full(3, 200, Wrap::Clamp), 5, 3).to_bytes();
        assert_eq!(fault(&forged(wide, 12, 5)), "a jump leads out of the exemplar");
    }

    proptest! {
        #[test]
        fn any_changed_byte_is_noticed(at in any::<proptest::sample::Index>(), with in 1u8..) {
            let mut bytes = small().to_bytes();
            let at = at.index(bytes.len());
            bytes[at] ^= with;
            prop_assert!(JumpMap::from_bytes(&bytes).is_err());
        }

        #[test]
        fn no_bytes_panic(tail in proptest::collection::vec(any::<u8>(), 0..200), masked in 0u32..2) {
            let mut bytes = random(Domain::full(30, 20, Wrap::Clamp), 100, 3).to_bytes();
            bytes.truncate(28 + 200);
            bytes.extend(tail);
            let _ = JumpMap::from_bytes(&forged(bytes.clone(), 20, 1200));
            let _ = JumpMap::from_bytes(&forged(bytes, 24, 0x0064_0000 | masked << 8));
        }
    }
}
