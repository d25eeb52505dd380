//! File names of consecutive frames, as printf writes them: `smoke_%04d.png`.
//!
//! In: a pattern; then the names of the files that there are. Out: the number of the first frame and how many follow it,
//! or why they are no flipbook.
//! Unaware of: folders, what the files hold.

use super::limits;
use std::fmt;
use std::ops::RangeInclusive;

/// A file name with a number in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FramePattern {
    before: String,
    /// Least number of digits; fewer are filled up with zeros.
    digits: usize,
    after: String,
}

/// Why files are not the frames of a flipbook. Reads on after the pattern and ": ".
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FrameError {
    /// There is no file of such a name.
    None {
        /// The names that the first frame may have.
        first: [String; 2],
    },
    /// The lowest number is neither 0 nor 1.
    First {
        /// The name of the first file.
        found: String,
    },
    /// A number is left out.
    Missing {
        /// The name of the first missing frame.
        name: String,
        /// The name of the next one that is there.
        next: String,
    },
    /// There is one frame, or there are too many.
    Count {
        /// How many.
        found: usize,
    },
}

impl std::error::Error for FrameError {}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (least, most) = (limits::EXEMPLAR_FRAMES.start(), limits::EXEMPLAR_FRAMES.end());
        match self {
            FrameError::None { first: [a, b] } => write!(f, "there are no frames; the first one would be {a} or {b}"),
            FrameError::First { found } => {
                write!(f, "the first frame is {found}, but frames are counted from 0 or from 1")
            }
            FrameError::Missing { name, next } => write!(f, "{name} is missing, while there is {next}"),
            FrameError::Count { found: 1 } => {
                write!(f, "there is one frame only, and a flipbook needs {least} at least; a still is a `base_color`")
            }
            FrameError::Count { found } => write!(f, "there are {found} frames; a flipbook may have {least} to {most}"),
        }
    }
}

impl FramePattern {
    /// Reads a file name with exactly one `%d`, or `%0Nd` for N digits (1 to 9); `%%` stands for a percent sign. Else
    /// says what is wrong with it.
    pub fn parse(name: &str) -> Result<Self, &'static str> {
        let mut parts = [String::new(), String::new()];
        let mut digits = None;
        let mut rest = name;
        while let Some((text, tail)) = rest.split_once('%') {
            parts[usize::from(digits.is_some())].push_str(text);
            if let Some(tail) = tail.strip_prefix('%') {
                parts[usize::from(digits.is_some())].push('%');
                rest = tail;
                continue;
            }
            let (count, tail) = tail.split_once('d').ok_or("has a `%` that is no frame number")?;
            let width = match count.as_bytes() {
                [] => 1,
                [b'0', n @ b'1'..=b'9'] => usize::from(n - b'0'),
                _ => return Err("has a `%` that is no frame number"),
            };
            if digits.replace(width).is_some() {
                return Err("has two frame numbers");
            }
            rest = tail;
        }
        parts[usize::from(digits.is_some())].push_str(rest);
        let [before, after] = parts;
        digits.map(|digits| FramePattern { before, digits, after }).ok_or("has no frame number")
    }

    /// The file name of a frame.
    pub fn name(&self, frame: u32) -> String {
        format!("{}{frame:0digits$}{}", self.before, self.after, digits = self.digits)
    }

    /// The frame that a file name stands for.
    fn frame(&self, name: &str) -> Option<u32> {
        let number = name.strip_prefix(&self.before)?.strip_suffix(&self.after)?;
        number.parse().ok().filter(|frame| self.name(*frame) == name)
    }

    /// The numbers of the frames among file names, in any order: consecutive from 0 or 1, as many as a flipbook may have.
    pub fn frames<'a>(&self, names: impl Iterator<Item = &'a str>) -> Result<RangeInclusive<u32>, FrameError> {
        let mut found: Vec<u32> = names.filter_map(|name| self.frame(name)).collect();
        found.sort_unstable();
        found.dedup();
        let (Some(&first), Some(&last)) = (found.first(), found.last()) else {
            return Err(FrameError::None { first: [self.name(0), self.name(1)] });
        };
        if first > 1 {
            return Err(FrameError::First { found: self.name(first) });
        }
        if let Some(gap) = found.windows(2).find(|pair| pair[1] != pair[0] + 1) {
            return Err(FrameError::Missing { name: self.name(gap[0] + 1), next: self.name(gap[1]) });
        }
        if !limits::EXEMPLAR_FRAMES.contains(&found.len()) {
            return Err(FrameError::Count { found: found.len() });
        }
        Ok(first..=last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pattern(name: &str) -> FramePattern {
        FramePattern::parse(name).unwrap_or_else(|e| panic!("{name} {e}"))
    }

    #[test]
    fn patterns_are_read_as_printf_reads_them() {
        for (name, seventh) in
            [("a_%04d.png", "a_0007.png"), ("%d", "7"), ("a%02d", "a07"), ("50%%_%03d%%.png", "50%_007%.png")]
        {
            assert_eq!(pattern(name).name(7), seventh);
            assert_eq!(pattern(name).frame(seventh), Some(7));
        }
        assert_eq!(pattern("a%02d").name(1234), "a1234");
        assert_eq!(pattern("a%02d").frame("a1234"), Some(1234));
        for other in ["a7", "a007", "a", "ab", "a-7", "a+7", "a99999999999", "b07"] {
            assert_eq!(pattern("a%02d").frame(other), None, "{other}");
        }
        for (name, why) in [
            ("a.png", "has no frame number"),
            ("a_%%.png", "has no frame number"),
            ("%d_%d.png", "has two frame numbers"),
            ("a_%4d.png", "has a `%` that is no frame number"),
            ("a_%s.png", "has a `%` that is no frame number"),
            ("a_%", "has a `%` that is no frame number"),
            ("a_%00d", "has a `%` that is no frame number"),
        ] {
            assert_eq!(FramePattern::parse(name), Err(why), "{name}");
        }
    }

    #[test]
    fn frames_are_consecutive_from_0_or_1() {
        let frames = |names: &[&str]| pattern("f%02d").frames(names.iter().copied());
        assert_eq!(frames(&["f02", "x", "f01", "f03", "f3"]), Ok(1..=3));
        assert_eq!(frames(&["f00", "f01"]), Ok(0..=1));
        let said = |names: &[&str]| frames(names).unwrap_err().to_string();
        assert_eq!(said(&["f"]), "there are no frames; the first one would be f00 or f01");
        assert_eq!(said(&["f05", "f06"]), "the first frame is f05, but frames are counted from 0 or from 1");
        assert_eq!(said(&["f01", "f02", "f05", "f06"]), "f03 is missing, while there is f05");
        assert_eq!(
            said(&["f00"]),
            "there is one frame only, and a flipbook needs 2 at least; a still is a `base_color`"
        );
        let many: Vec<String> = (0..1025).map(|i| pattern("f%02d").name(i)).collect();
        let many: Vec<&str> = many.iter().map(String::as_str).collect();
        assert_eq!(said(&many), "there are 1025 frames; a flipbook may have 2 to 1024");
    }

    proptest! {
        #[test]
        fn no_name_panics(name in "[a%0d9]{0,9}", file in "[a09]{0,9}") {
            if let Ok(pattern) = FramePattern::parse(&name) {
                let _ = pattern.frames([file.as_str()].into_iter());
                prop_assert_eq!(pattern.frame(&pattern.name(31)), Some(31));
            }
        }
    }
}
