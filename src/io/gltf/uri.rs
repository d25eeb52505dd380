//! URIs of a scene: data that they hold, or the file beside the scene that they name.
//!
//! Source: glTF 2.0, 2.8 (URIs) and 3.6.1; RFC 2397 and 4648 for data URIs.
//! Reads as: a path must stay inside the scene's folder; other schemes are refused, for kiln works offline. A backslash
//! is taken for a slash, as Windows exporters write it.

use crate::io::SceneError;

/// Where the bytes of a URI are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// In the URI itself.
    Data(Vec<u8>),
    /// In a file, its path relative to the scene with forward slashes.
    File(String),
}

/// Reads a URI.
pub(super) fn target(uri: &str) -> Result<Target, SceneError> {
    let refuse = |what: &str| SceneError::Uri { uri: uri.into(), what: what.into() };
    if uri.get(..5).is_some_and(|s| s.eq_ignore_ascii_case("data:")) {
        let (head, body) = uri[5..].split_once(',').ok_or_else(|| refuse("a data URI without a comma"))?;
        let mut parts = head.split(';').skip(1).collect::<Vec<_>>();
        if parts.pop() != Some("base64") || parts.contains(&"") {
            return Err(refuse("a data URI that is not `data:<type>;base64,...`"));
        }
        return base64(body.as_bytes()).map(Target::Data).map_err(|what| refuse(&what));
    }
    let scheme = uri.split_once(':').map(|(s, _)| s);
    if let Some(s) = scheme.filter(|s| s.chars().all(|c| c.is_ascii_alphanumeric() || "+.-".contains(c))) {
        return Err(refuse(&format!(
            "`{s}:` is not followed, kiln works offline; allowed: data URIs and relative paths"
        )));
    }
    let path = percent_decode(uri).ok_or_else(|| refuse("bad percent-encoding"))?.replace('\\', "/");
    if path.starts_with('/') {
        return Err(refuse("an absolute path; allowed: paths relative to the scene"));
    }
    if path.contains('\0') {
        return Err(refuse("a path with a zero byte"));
    }
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." if parts.pop().is_none() => return Err(refuse("a path that climbs out of the scene's folder")),
            ".." => {}
            _ => parts.push(part),
        }
    }
    if parts.is_empty() { Err(refuse("a path that names no file")) } else { Ok(Target::File(parts.join("/"))) }
}

fn percent_decode(s: &str) -> Option<String> {
    let mut out = Vec::with_capacity(s.len());
    let mut bytes = s.bytes();
    while let Some(b) = bytes.next() {
        if b == b'%' {
            let digit = |b: Option<u8>| (b? as char).to_digit(16);
            out.push((digit(bytes.next())? * 16 + digit(bytes.next())?) as u8);
        } else {
            out.push(b);
        }
    }
    String::from_utf8(out).ok()
}

/// The standard alphabet, with or without padding.
fn base64(text: &[u8]) -> Result<Vec<u8>, String> {
    let padding = text.iter().rev().take(2).take_while(|&&b| b == b'=').count();
    let digits = &text[..text.len() - padding];
    if digits.len() % 4 == 1 || (padding > 0 && !text.len().is_multiple_of(4)) {
        return Err(format!("{} characters are no whole base64", text.len()));
    }
    let mut out = Vec::with_capacity(digits.len() / 4 * 3 + 2);
    for (q, chunk) in digits.chunks(4).enumerate() {
        let mut word = 0u32;
        for (i, &b) in chunk.iter().enumerate() {
            let value = match b {
                b'A'..=b'Z' => b - b'A',
                b'a'..=b'z' => b - b'a' + 26,
                b'0'..=b'9' => b - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                _ => return Err(format!("character {} of the data is not base64", 4 * q + i + 1)),
            };
            word |= u32::from(value) << (18 - 6 * i);
        }
        out.extend_from_slice(&word.to_be_bytes()[1..chunk.len()]);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(uri: &str) -> bool {
        matches!(target(uri), Err(SceneError::Uri { .. }))
    }

    #[test]
    fn relative_paths_are_decoded_and_kept_inside_the_folder() {
        let file = |uri: &str| target(uri).unwrap();
        assert_eq!(file("a%20b/%C3%A9.bin"), Target::File("a b/é.bin".into()));
        assert_eq!(file("./tex/../x.png"), Target::File("x.png".into()));
        assert_eq!(file("tex\\x.png"), Target::File("tex/x.png".into()));
        for bad in [
            "../x.bin",
            "a/../../x",
            "%2e%2e/x",
            "..\\x",
            "/etc/passwd",
            "http://h/x.bin",
            "file:///x",
            "C:\\x.bin",
            "",
            "a%zz",
            "a%2",
            "%ff",
            "a%00b",
            "..",
        ] {
            assert!(refused(bad), "{bad}");
        }
    }

    #[test]
    fn data_uris() {
        let data = |s: &str| target(&format!("data:application/octet-stream;base64,{s}"));
        assert_eq!(data("AAEC").unwrap(), Target::Data(vec![0, 1, 2]));
        assert_eq!(data("+/8=").unwrap(), Target::Data(vec![0xfb, 0xff]));
        assert_eq!(data("AQ").unwrap(), Target::Data(vec![1]));
        assert_eq!(data("").unwrap(), Target::Data(vec![]));
        for bad in ["A", "A===", "AB=C", "A*AA", "AA=", "====", "AA=="] {
            assert_eq!(data(bad).is_err(), bad != "AA==", "{bad}");
        }
        assert!(refused("data:text/plain,abc") && refused("data:a;;base64,AA==") && refused("data:a;base64"));
    }
}
