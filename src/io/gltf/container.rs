//! The .glb container, and the JSON text of a .gltf.
//!
//! Source: glTF 2.0, 4.4 (binary glTF). Unaware of: what the JSON says.

use std::borrow::Cow;

use serde_json::Value;

use crate::io::SceneError;

const JSON: u32 = 0x4e4f_534a;
const BIN: u32 = 0x004e_4942;

fn fault<T>(what: impl Into<String>) -> Result<T, SceneError> {
    Err(SceneError::Container(what.into()))
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// Splits a .glb into its JSON text and its binary chunk.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), SceneError> {
    let (Some(version), Some(length)) = (word(bytes, 4), word(bytes, 8)) else {
        return fault(format!("a .glb of {} bytes; its header alone has 12", bytes.len()));
    };
    if !bytes.starts_with(b"glTF") {
        let magic = String::from_utf8_lossy(&bytes[..4]);
        return fault(format!("not a .glb: it begins with {magic:?}, expected \"glTF\""));
    }
    if version != 2 {
        return fault(format!("container version {version}; kiln reads version 2"));
    }
    if length as usize != bytes.len() {
        return fault(format!("the header says {length} bytes, the file has {}", bytes.len()));
    }
    let (mut json, mut bin, mut at, mut index) = (None, None, 12, 0);
    while at < bytes.len() {
        let (Some(len), Some(kind)) = (word(bytes, at), word(bytes, at + 4)) else {
            return fault(format!("{} bytes after chunk {index}; a chunk header has 8", bytes.len() - at));
        };
        let Some(data) = bytes.get(at + 8..).and_then(|rest| rest.get(..len as usize)) else {
            return fault(format!("chunk {index} says {len} bytes, {} are left", bytes.len() - at - 8));
        };
        if len % 4 != 0 {
            return fault(format!("chunk {index} has {len} bytes, which is no multiple of 4"));
        }
        match (index, kind) {
            (0, JSON) if len == 0 => return fault("the JSON chunk is empty"),
            (0, JSON) => json = Some(data),
            (0, _) => return fault(format!("the first chunk is of type {kind:#010x}, expected JSON")),
            (_, JSON) => return fault("two JSON chunks"),
            (1, BIN) => bin = Some(data),
            (_, BIN) if bin.is_some() => return fault("two BIN chunks"),
            (_, BIN) => return fault(format!("the BIN chunk is chunk {index}, expected 1")),
            _ => {}
        }
        (at, index) = (at + 8 + len as usize, index + 1);
    }
    json.map(|j| (j, bin)).ok_or_else(|| SceneError::Container("a .glb without a JSON chunk".into()))
}

/// Parses JSON text (UTF-8, with or without a byte order mark).
pub(super) fn json(text: &[u8]) -> Result<Value, SceneError> {
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
    if text.iter().all(u8::is_ascii_whitespace) {
        return fault("the file is empty; expected glTF JSON");
    }
    if let Err(e) = std::str::from_utf8(text) {
        return fault(format!("the JSON is not UTF-8: byte {} is {:#04x}", e.valid_up_to(), text[e.valid_up_to()]));
    }
    match serde_json::from_slice(text) {
        Ok(Value::Object(root)) => Ok(Value::Object(root)),
        Ok(_) => fault("the JSON is not an object"),
        Err(e) => fault(format!("the JSON is broken: {e}")),
    }
}

/// Binary data in pieces, so that they are copied once only; zeros between them.
#[derive(Default)]
pub(super) struct Bin<'a> {
    pieces: Vec<(usize, Cow<'a, [u8]>)>,
    len: usize,
}

impl<'a> Bin<'a> {
    /// Bytes so far.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Zeros up to the next multiple of eight and `more`.
    pub(super) fn align(&mut self, more: usize) {
        self.len = self.len.next_multiple_of(8) + more;
    }

    /// Adds bytes.
    pub(super) fn push(&mut self, bytes: impl Into<Cow<'a, [u8]>>) {
        let bytes = bytes.into();
        let at = self.len;
        self.len += bytes.len();
        self.pieces.push((at, bytes));
    }
}

/// Joins JSON and binary data into a .glb.
pub(super) fn join(root: &Value, bin: Bin) -> Result<Vec<u8>, SceneError> {
    let json = serde_json::to_vec(root).map_err(|e| SceneError::Mismatch(format!("JSON: {e}")))?;
    let padded = |len: usize| len.next_multiple_of(4);
    let chunk = |len: usize| if len > 0 { 8 + padded(len) } else { 0 };
    let total = 12 + chunk(json.len()) + chunk(bin.len);
    let Ok(length) = u32::try_from(total) else {
        return Err(SceneError::TooLarge(format!("the .glb would have {total} bytes; at most {} fit", u32::MAX)));
    };
    let mut out = Vec::with_capacity(total);
    out.extend_from_slice(b"glTF");
    [2, length, padded(json.len()) as u32, JSON].iter().for_each(|w| out.extend_from_slice(&w.to_le_bytes()));
    out.extend_from_slice(&json);
    out.resize(out.len().next_multiple_of(4), b' ');
    if bin.len > 0 {
        [padded(bin.len) as u32, BIN].iter().for_each(|w| out.extend_from_slice(&w.to_le_bytes()));
        let start = out.len();
        for (at, bytes) in bin.pieces {
            out.resize(start + at, 0);
            out.extend_from_slice(&bytes);
        }
        out.resize(total, 0);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_joined_splits_again() {
        let mut bin = Bin::default();
        bin.push(vec![1, 2]);
        bin.align(1);
        bin.push(&[3, 4, 5][..]);
        assert_eq!(bin.len(), 12);
        let glb = join(&serde_json::json!({"asset": {"version": "2.0"}}), bin).unwrap();
        assert_eq!(glb.len() % 4, 0);
        let (text, bin) = split(&glb).unwrap();
        assert_eq!(json(text).unwrap()["asset"]["version"], "2.0");
        assert_eq!(bin.unwrap(), [1, 2, 0, 0, 0, 0, 0, 0, 0, 3, 4, 5]);
        for n in 0..glb.len() {
            assert!(split(&glb[..n]).is_err());
        }
    }

    #[test]
    fn json_keys_come_out_sorted_and_numbers_unchanged() {
        // The order of keys is part of the bytes: no dependency may switch on serde_json's preserve_order.
        let text = r#"{"a":0.1,"b":1.0,"c":18446744073709551615,"d":0.30000000000000004,"z":0.0000549349934}"#;
        let root = json(br#"{"z":5.49349934e-05,"d":0.30000000000000004,"a":0.1,"c":18446744073709551615,"b":1.0}"#);
        assert_eq!(serde_json::to_string(&root.unwrap()).unwrap(), text);
        assert!(json(b"").is_err() && json(b"[]").is_err() && json(b"\xff{}").is_err() && json(b"{").is_err());
        assert!(json(&[b"[".repeat(100_000), b"]".repeat(100_000)].concat()).is_err());
    }
}
