//! Little-endian bytes with a checked frame: what the manifest and the cache's records are written in.
//!
//! A frame is magic (8 bytes), length of the payload (u64), BLAKE3 of the payload, payload. Reading never panics and
//! never trusts a length: every read returns `None` beyond the end.
//!
//! Unaware of: what is stored.

use super::digest::Digest;
use crate::disk::Stamp;

const HEADER: usize = 8 + 8 + 32;

/// The payload of a frame, if it is whole and undamaged and of this magic.
pub(super) fn open_frame<'a>(magic: &[u8; 8], frame: &'a [u8]) -> Option<Reader<'a>> {
    let mut reader = Reader(frame);
    if reader.take(8)? != magic {
        return None;
    }
    let len = reader.u64()?;
    let digest = reader.digest()?;
    (reader.0.len() as u64 == len && Digest::of(reader.0) == digest).then_some(reader)
}

/// Builds a frame.
pub(super) struct Writer(Vec<u8>);

impl Writer {
    /// An empty frame of this magic.
    pub fn new(magic: &[u8; 8]) -> Self {
        let mut bytes = magic.to_vec();
        bytes.resize(HEADER, 0);
        Writer(bytes)
    }

    /// Plain bytes without a frame, for a part of one.
    pub fn part() -> Self {
        Writer(Vec::new())
    }

    /// Raw bytes without their length.
    pub fn raw(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    /// A 32-bit number.
    pub fn u32(&mut self, value: u32) {
        self.raw(&value.to_le_bytes());
    }

    /// A 64-bit number.
    pub fn u64(&mut self, value: u64) {
        self.raw(&value.to_le_bytes());
    }

    /// A digest.
    pub fn digest(&mut self, value: &Digest) {
        self.raw(value.as_bytes());
    }

    /// Bytes preceded by their length; at most 4 GiB.
    pub fn bytes(&mut self, bytes: &[u8]) {
        debug_assert!(u32::try_from(bytes.len()).is_ok());
        self.u32(bytes.len() as u32);
        self.raw(bytes);
    }

    /// A stamp or none.
    pub fn stamp(&mut self, stamp: Option<Stamp>) {
        self.raw(&[u8::from(stamp.is_some())]);
        if let Some(Stamp { len, mtime_ns, inode }) = stamp {
            self.u64(len);
            self.raw(&mtime_ns.to_le_bytes());
            self.u64(inode);
        }
    }

    /// The bytes of a part.
    pub fn into_part(self) -> Vec<u8> {
        self.0
    }

    /// The frame, with length and digest filled in.
    pub fn finish(mut self) -> Vec<u8> {
        let payload = &self.0[HEADER..];
        let (len, digest) = (payload.len() as u64, Digest::of(payload));
        self.0[8..16].copy_from_slice(&len.to_le_bytes());
        self.0[16..HEADER].copy_from_slice(digest.as_bytes());
        self.0
    }
}

/// Reads what [`Writer`] wrote, in the same order.
#[derive(Clone, Copy)]
pub(super) struct Reader<'a>(pub &'a [u8]);

impl<'a> Reader<'a> {
    /// The next `n` bytes.
    pub fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    /// A 32-bit number.
    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    /// A 64-bit number.
    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// A digest.
    pub fn digest(&mut self) -> Option<Digest> {
        self.array().map(Digest::from_bytes)
    }

    /// Bytes preceded by their length.
    pub fn bytes(&mut self) -> Option<&'a [u8]> {
        let len = self.u32()?;
        self.take(len as usize)
    }

    /// Text preceded by its length.
    pub fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?).ok()
    }

    /// A stamp or none.
    pub fn stamp(&mut self) -> Option<Option<Stamp>> {
        if self.array::<1>()? == [0] {
            return Some(None);
        }
        let len = self.u64()?;
        let mtime_ns = i128::from_le_bytes(self.array()?);
        Some(Some(Stamp { len, mtime_ns, inode: self.u64()? }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Vec<u8> {
        let mut writer = Writer::new(b"TESTTEST");
        writer.u64(7);
        writer.bytes(b"moss");
        writer.stamp(Some(Stamp { len: 3, mtime_ns: -5, inode: 9 }));
        writer.stamp(None);
        writer.digest(&Digest::of(b"x"));
        writer.finish()
    }

    #[test]
    fn reads_back_what_was_written() {
        let frame = sample();
        let mut reader = open_frame(b"TESTTEST", &frame).unwrap();
        assert_eq!(reader.u64(), Some(7));
        assert_eq!(reader.text(), Some("moss"));
        assert_eq!(reader.stamp(), Some(Some(Stamp { len: 3, mtime_ns: -5, inode: 9 })));
        assert_eq!(reader.stamp(), Some(None));
        assert_eq!(reader.digest(), Some(Digest::of(b"x")));
        assert_eq!(reader.u32(), None, "nothing is left");
    }

    #[test]
    fn any_damage_is_noticed() {
        let frame = sample();
        assert!(open_frame(b"OTHERSIX", &frame).is_none());
        for i in 0..frame.len() {
            let mut damaged = frame.clone();
            damaged[i] ^= 1;
            assert!(open_frame(b"TESTTEST", &damaged).is_none(), "byte {i} flipped");
            assert!(open_frame(b"TESTTEST", &frame[..i]).is_none(), "cut to {i} bytes");
        }
    }
}
