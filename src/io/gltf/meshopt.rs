//! The bitstreams of EXT_meshopt_compression and KHR_meshopt_compression, decoded.
//!
//! Source: KHR_meshopt_compression, appendix A (its version 0 streams are those of EXT_meshopt_compression).
//! In: the compressed bytes of one buffer view, element count and size. Out: the bytes of the view.
//! Reads as: a FIFO entry that was never written makes a stream invalid, so entries start empty.
//! Unaware of: JSON, buffers, filters (see `meshopt_filter`).

/// What is wrong with a stream.
pub(super) type Fault = &'static str;

const ENDS_EARLY: Fault = "the compressed data ends early";
const LEFT_OVER: Fault = "the compressed data has bytes left over";
/// Elements whose deltas share one bit width.
const GROUP: usize = 16;

/// A cursor that cannot leave its slice.
struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], Fault> {
        let (head, rest) = self.rest.split_at_checked(n).ok_or(ENDS_EARLY)?;
        self.rest = rest;
        Ok(head)
    }

    fn byte(&mut self) -> Result<u8, Fault> {
        Ok(self.take(1)?[0])
    }

    /// Unsigned LEB128 of at most five bytes; bits beyond 32 are dropped.
    fn varint(&mut self) -> Result<u32, Fault> {
        let mut value = 0u32;
        for shift in [0, 7, 14, 21, 28] {
            let b = self.byte()?;
            value |= u32::from(b & 0x7f) << shift;
            if b & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err("a number of more than five bytes")
    }
}

fn unzigzag(v: u32) -> u32 {
    (v >> 1) ^ (v & 1).wrapping_neg()
}

/// Elements per block of mode 0.
fn block_elements(stride: usize) -> usize {
    ((8192 / stride) & !(GROUP - 1)).min(256)
}

/// Fewest bytes in which mode 0 can hold `count` elements: checked before memory is taken for the result.
pub(super) fn least_attribute_bytes(count: usize, stride: usize) -> usize {
    // Version 1 can do with a control byte per four bytes of element and block, version 0 needs more.
    (count.div_ceil(block_elements(stride))).saturating_mul(stride / 4)
}

/// Mode 0: `count` elements of `stride` bytes (a multiple of 4, at most 256).
pub(super) fn attributes(data: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, Fault> {
    let mut reader = Reader { rest: data };
    let version = match reader.byte()? {
        0xa0 => 0,
        0xa1 => 1,
        _ => return Err("the first byte is not that of an attribute stream (0xa0 or 0xa1)"),
    };
    let channel_bytes = if version == 0 { 0 } else { stride / 4 };
    let tail_size = (stride + channel_bytes).max(if version == 0 { 32 } else { 24 });
    let body = reader.rest.len().checked_sub(tail_size).ok_or(ENDS_EARLY)?;
    let (body, tail) = reader.rest.split_at(body);
    let (baseline, channels) = tail[tail_size - stride - channel_bytes..].split_at(stride);
    if channels.iter().any(|c| (c & 15) > 2 || ((c & 15) < 2 && c >> 4 != 0)) {
        return Err("an unknown channel mode");
    }
    let mut reader = Reader { rest: body };
    let mut out = vec![0u8; count * stride];
    let mut last = baseline.to_vec();
    for block in out.chunks_mut(block_elements(stride) * stride) {
        attribute_block(&mut reader, block, stride, &mut last, (version == 1).then_some(channels))?;
    }
    if reader.rest.is_empty() { Ok(out) } else { Err(LEFT_OVER) }
}

/// One block: per byte of the element a plane of deltas, then the deltas summed per channel of four bytes.
fn attribute_block(
    reader: &mut Reader,
    block: &mut [u8],
    stride: usize,
    last: &mut [u8],
    channels: Option<&[u8]>,
) -> Result<(), Fault> {
    let n = block.len() / stride;
    let padded = n.next_multiple_of(GROUP);
    let control = match channels {
        Some(_) => reader.take(stride / 4)?,
        None => &[],
    };
    let mut planes = [[0u8; 256]; 4];
    for k in 0..stride / 4 {
        for (j, plane) in planes.iter_mut().enumerate() {
            match (channels, control.get(k).map_or(0, |c| c >> (2 * j) & 3)) {
                (Some(_), 3) => plane[..n].copy_from_slice(reader.take(n)?),
                (Some(_), 2) => plane.fill(0),
                (Some(_), 1) => delta_plane(reader, &mut plane[..padded], [1, 2, 4, 8])?,
                (Some(_), _) => delta_plane(reader, &mut plane[..padded], [0, 1, 2, 4])?,
                (None, _) => delta_plane(reader, &mut plane[..padded], [0, 2, 4, 8])?,
            }
        }
        let mode = channels.map_or(0, |c| c[k]);
        let mut previous = [0; 4];
        previous.copy_from_slice(&last[4 * k..4 * k + 4]);
        for i in 0..n {
            let delta = [planes[0][i], planes[1][i], planes[2][i], planes[3][i]];
            previous = apply_delta(mode, previous, delta);
            block[i * stride + 4 * k..i * stride + 4 * k + 4].copy_from_slice(&previous);
        }
        last[4 * k..4 * k + 4].copy_from_slice(&previous);
    }
    Ok(())
}

/// Channel modes: 0 byte differences, 1 differences of 16 bits, 2 exclusive or of 32 rotated bits.
fn apply_delta(mode: u8, previous: [u8; 4], delta: [u8; 4]) -> [u8; 4] {
    match mode & 15 {
        0 => std::array::from_fn(|j| previous[j].wrapping_add((delta[j] >> 1) ^ (delta[j] & 1).wrapping_neg())),
        1 => {
            let half = |j: usize| {
                let d = u16::from_le_bytes([delta[j], delta[j + 1]]);
                let p = u16::from_le_bytes([previous[j], previous[j + 1]]);
                p.wrapping_add((d >> 1) ^ (d & 1).wrapping_neg()).to_le_bytes()
            };
            let (a, b) = (half(0), half(2));
            [a[0], a[1], b[0], b[1]]
        }
        _ => {
            // The stream holds the difference rotated left by the mode's high bits; turning back gives the difference.
            let d = u32::from_le_bytes(delta).rotate_right(u32::from(mode >> 4));
            (u32::from_le_bytes(previous) ^ d).to_le_bytes()
        }
    }
}

/// Deltas of one byte position in groups of 16, each with one of four bit widths.
fn delta_plane(reader: &mut Reader, plane: &mut [u8], widths: [u32; 4]) -> Result<(), Fault> {
    let header = reader.take((plane.len() / GROUP).div_ceil(4))?;
    for (g, group) in plane.chunks_exact_mut(GROUP).enumerate() {
        let bits = widths[usize::from(header[g / 4] >> (2 * (g % 4)) & 3)];
        match bits {
            0 => group.fill(0),
            8 => group.copy_from_slice(reader.take(GROUP)?),
            _ => {
                let packed = reader.take(2 * bits as usize)?;
                let per_byte = 8 / bits as usize;
                let sentinel = (1u8 << bits) - 1;
                for (i, out) in group.iter_mut().enumerate() {
                    let at = (i % per_byte) as u32 * bits;
                    // One-bit deltas run from the low bit up, the others from the high bits down.
                    let shift = if bits == 1 { at } else { 8 - bits - at };
                    let value = packed[i / per_byte] >> shift & sentinel;
                    *out = if value == sentinel { reader.byte()? } else { value };
                }
            }
        }
    }
    Ok(())
}

/// The last sixteen entries, the newest first; reading one that was never written is a fault.
struct Fifo<T> {
    entries: [Option<T>; 16],
    next: usize,
}

impl<T: Copy> Fifo<T> {
    fn new() -> Self {
        Fifo { entries: [None; 16], next: 0 }
    }

    fn push(&mut self, value: T) {
        self.entries[self.next] = Some(value);
        self.next = (self.next + 1) % 16;
    }

    fn get(&self, age: u8) -> Result<T, Fault> {
        self.entries[(self.next + 15 - usize::from(age)) % 16].ok_or("an entry of an empty FIFO is read")
    }
}

/// State of the triangle decoder.
struct Triangles<'a> {
    data: Reader<'a>,
    next: u32,
    last: u32,
    edges: Fifo<[u32; 2]>,
    vertices: Fifo<u32>,
}

impl Triangles<'_> {
    fn fresh(&mut self) -> u32 {
        let v = self.next;
        self.next = v.wrapping_add(1);
        v
    }

    fn explicit(&mut self) -> Result<u32, Fault> {
        self.last = self.last.wrapping_add(unzigzag(self.data.varint()?));
        Ok(self.last)
    }

    /// A known edge and a third vertex.
    fn with_edge(&mut self, edge: u8, third: u8) -> Result<[u32; 3], Fault> {
        let [a, b] = self.edges.get(edge)?;
        let c = match third {
            0 => self.fresh(),
            13 => self.last.wrapping_sub(1),
            14 => self.last.wrapping_add(1),
            15 => self.explicit()?,
            age => self.vertices.get(age)?,
        };
        if third >= 13 {
            self.last = c;
        }
        if third == 0 || third >= 13 {
            self.vertices.push(c);
        }
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        Ok([a, b, c])
    }

    /// Three vertices: `codes` 0 is the next new one, 15 explicit, else an age in the FIFO plus one.
    fn with_vertices(&mut self, codes: [u8; 3]) -> Result<[u32; 3], Fault> {
        let mut t = [0; 3];
        // New and remembered vertices first: they are read before any explicit index moves the FIFO or `last`.
        for (v, &code) in t.iter_mut().zip(&codes) {
            *v = match code {
                0 => self.fresh(),
                15 => 0,
                age => self.vertices.get(age - 1)?,
            };
        }
        for (v, &code) in t.iter_mut().zip(&codes) {
            if code == 15 {
                *v = self.explicit()?;
            }
        }
        let [a, b, c] = t;
        for (v, code) in t.into_iter().zip(codes) {
            if code == 0 || code == 15 {
                self.vertices.push(v);
            }
        }
        self.edges.push([b, a]);
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        Ok(t)
    }
}

/// Mode 1: `count` indices of a triangle list (a multiple of 3).
pub(super) fn triangles(data: &[u8], count: usize) -> Result<Vec<u32>, Fault> {
    let mut reader = Reader { rest: data };
    if reader.byte()? != 0xe1 {
        return Err("the first byte is not that of a triangle stream (0xe1)");
    }
    let codes = reader.take(count / 3)?;
    let body = reader.rest.len().checked_sub(16).ok_or(ENDS_EARLY)?;
    let (body, table) = reader.rest.split_at(body);
    let mut state =
        Triangles { data: Reader { rest: body }, next: 0, last: 0, edges: Fifo::new(), vertices: Fifo::new() };
    let mut out = Vec::with_capacity(count);
    for &code in codes {
        let triangle = match (code >> 4, code & 15) {
            (15, low @ 14..) => {
                let aux = state.data.byte()?;
                if aux == 0 {
                    state.next = 0;
                }
                state.with_vertices([if low == 14 { 0 } else { 15 }, aux >> 4, aux & 15])?
            }
            (15, low) => {
                let aux = table[usize::from(low)];
                if aux >> 4 == 15 || aux & 15 == 15 {
                    return Err("the table of a triangle stream holds 15");
                }
                state.with_vertices([0, aux >> 4, aux & 15])?
            }
            (edge, third) => state.with_edge(edge, third)?,
        };
        out.extend(triangle);
    }
    if state.data.rest.is_empty() { Ok(out) } else { Err(LEFT_OVER) }
}

/// Mode 2: `count` indices of any topology.
pub(super) fn indices(data: &[u8], count: usize) -> Result<Vec<u32>, Fault> {
    let mut reader = Reader { rest: data };
    if reader.byte()? != 0xd1 {
        return Err("the first byte is not that of an index stream (0xd1)");
    }
    let body = reader.rest.len().checked_sub(4).ok_or(ENDS_EARLY)?;
    if count > body {
        return Err(ENDS_EARLY);
    }
    let mut reader = Reader { rest: &reader.rest[..body] };
    let mut last = [0u32; 2];
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let v = reader.varint()?;
        let baseline = &mut last[(v & 1) as usize];
        *baseline = baseline.wrapping_add(unzigzag(v >> 1));
        out.push(*baseline);
    }
    if reader.rest.is_empty() { Ok(out) } else { Err(LEFT_OVER) }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Bytes of hexadecimal text.
    pub(in super::super) fn hex(text: &str) -> Vec<u8> {
        text.as_bytes().chunks(2).map(|d| u8::from_str_radix(std::str::from_utf8(d).unwrap(), 16).unwrap()).collect()
    }

    /// Twenty elements of two 16-bit ramps, a float and an integer, encoded by meshoptimizer 1.3.
    const V0: &str = "a007002f2f2f2f2f2f2f2f2f2f2f2f2f2f2fff0000002f2f2f2f0a0688888888868888888800000000000007005757575757\
        57575757575757575757ff0000005757575705355d55d50303035d0000000300000700101010101010101010101010101010\
        ff00000010080808048000000005303c0f030edcdb393ab0c0000000af05003c0f03c0bf7f8042c00000004105003c0f032a\
        29545380c00000007f05003c0f032e2d5c5b8ac0000000890000000000000000000000000000000000000000000000000000\
        803f00000000";
    const V1: &str = "a177ba5500d0d0d0d0d0d0d0d0d0d0d0d0d0d0d0d0d0d0d00207777777777777770f00070707070057575757575757575757\
        575757575757575757052aaaaaaaaa000000001010101010101010101010101010101008080800628c0edcdb393ab00100af\
        00608cc0bf7f804201004100608c2a2954538001007f00608c2e2d5c5b8a010089000000000000000000000000000000803f\
        00000000010100";

    fn ramps() -> Vec<u8> {
        let element = |i: u32| {
            let last = if i.is_multiple_of(5) { i.wrapping_mul(2_654_435_761) } else { 7 };
            let ramp = [(1000 * i) as u16, (-300 * i as i32) as u16].map(u16::to_le_bytes).concat();
            [ramp, (1.0 + i as f32 / 16.0).to_le_bytes().to_vec(), last.to_le_bytes().to_vec()].concat()
        };
        (0..20).flat_map(element).collect()
    }

    #[test]
    fn attributes_of_both_versions() {
        for text in [V0, V1] {
            assert_eq!(attributes(&hex(text), 20, 12).unwrap(), ramps());
        }
        // Exclusive or with turned bits, literal bytes.
        let floats: Vec<u8> = (0..17).flat_map(|i| (i as f32 * 0.25 - 3.0).to_le_bytes()).collect();
        let code = "a1e8012030070b030007010301fe0206020c0418e8e818040c00000000000000000000000000000000000000000040c042";
        assert_eq!(attributes(&hex(code), 17, 4).unwrap(), floats);
        let inverses: Vec<u8> = (0..17).flat_map(|i| (1.0 / (i as f32 + 1.0)).to_le_bytes()).collect();
        let code = "a1bf0000a9aa65430b498d287e3ea367c8ee1d0000aaaa6644c392e37dc3f841817eee1e00ffab5367432f23392d231f1915\
            130f1f000000000000000000000000000000000000000000803f01";
        assert_eq!(attributes(&hex(code), 17, 4).unwrap(), inverses);
    }

    const INDICES: [u32; 24] = [0, 1, 2, 2, 1, 3, 3, 1, 4, 9, 8, 7, 7, 8, 20, 0, 1, 30, 500, 2, 30, 29, 30, 500];
    const TRIANGLES: &str = "e1f01010ff1fffffffff1201011a8f273c91ac0721ad07007687566778a9866589689801690000";
    const SEQUENCE: &str = "d100040400020800060c1402020004304e0474d10f6e7002040100000000";

    #[test]
    fn triangles_and_index_sequences() {
        let turned = |t: &[u32]| {
            let k = (0..3).min_by_key(|&k| t[k]).unwrap();
            [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]
        };
        let decoded = triangles(&hex(TRIANGLES), 24).unwrap();
        let (a, b): (Vec<_>, Vec<_>) =
            (decoded.chunks(3).map(turned).collect(), INDICES.chunks(3).map(turned).collect());
        assert_eq!(a, b);
        assert_eq!(indices(&hex(SEQUENCE), 24).unwrap(), INDICES);
    }

    #[test]
    fn damaged_streams_are_faults() {
        let streams = [hex(V0), hex(V1), hex(TRIANGLES), hex(SEQUENCE)];
        let decode = |which: usize, data: &[u8]| match which {
            0 | 1 => attributes(data, 20, 12).map(|_| ()),
            2 => triangles(data, 24).map(|_| ()),
            _ => indices(data, 24).map(|_| ()),
        };
        for (which, stream) in streams.iter().enumerate() {
            assert_eq!(decode(which, stream), Ok(()));
            for n in 0..stream.len() {
                assert!(decode(which, &stream[..n]).is_err(), "{which} cut to {n}");
            }
            assert!(decode(which, &[stream.as_slice(), &[0]].concat()).is_err());
            for at in 0..stream.len() {
                for flip in [1u8, 0x80, 0xff] {
                    let mut spoilt = stream.clone();
                    spoilt[at] ^= flip;
                    let _ = decode(which, &spoilt);
                }
            }
        }
        assert!(triangles(&[&[0xe1, 0x10], &[0; 16][..]].concat(), 3).unwrap_err().contains("FIFO"));
    }

    #[test]
    fn a_small_stream_cannot_ask_for_much() {
        assert!(least_attribute_bytes(usize::MAX / 256, 256) > 1 << 40);
        // Two blocks of 256 equal elements take a control byte each.
        let stream = [&[0xa1, 0b1010_1010, 0b1010_1010][..], &[0; 24]].concat();
        assert_eq!(attributes(&stream, 512, 4).unwrap(), [0; 2048]);
        assert_eq!(least_attribute_bytes(512, 4), 2);
    }
}
