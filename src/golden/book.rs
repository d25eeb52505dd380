//! The golden book of a recipe: `golden/<recipe>.toml`.
//!
//! One `[[output]]` per output with the digest of its content, sorted by name, and one `[[step]]` per step with the
//! digest of its artefact, in the order of the graph, so that the first step that went another way can be named. The
//! layout is stable: the same book is the same text, and one changed output changes one entry of it.
//! Unaware of: how digests are made (see [`super::digest`]), where the file lies.

use super::compare::Difference;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::{self, Write};

/// The version of the layout, written as `kiln = 1`.
const FORMAT: i64 = 1;

const HEADER: &str = "\
# Golden record of kiln: what this recipe came out as when somebody looked and agreed.
# `kiln check` compares with it, `kiln accept` writes it. By hand, change nothing but tolerances, such as
#   tolerance = { max = 1.0, mean = 0.01 }    # in steps of 8 bits; for EXR in its own values
";

/// What an output is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A map of an atlas, or a flat texture.
    Map,
    /// A view by the built-in renderer.
    Render,
    /// A scene.
    Mesh,
    /// Anything else, compared byte by byte.
    File,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Kind::Map => "map",
            Kind::Render => "render",
            Kind::Mesh => "mesh",
            Kind::File => "file",
        }
    }
}

/// How far an image may be from the accepted one.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tolerance {
    /// Greatest difference of a sample, in the units of [`Difference`].
    pub max: f64,
    /// Mean difference over all samples.
    pub mean: f64,
}

impl Tolerance {
    /// True if the difference is within the tolerance.
    pub fn allows(&self, difference: &Difference) -> bool {
        difference.max <= self.max && difference.mean <= self.mean
    }
}

/// An output and what it was accepted as.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Output {
    /// File name below the recipe's output folder, with `/`.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// Width and height, of images.
    pub size: Option<[u32; 2]>,
    /// Samples per texel, of images.
    pub channels: Option<u32>,
    /// Digest of the content, 64 hexadecimal digits.
    pub blake3: String,
    /// How far the image may differ; without, it must be the same.
    pub tolerance: Option<Tolerance>,
    /// Measured figures, for the reader; not compared.
    #[serde(default)]
    pub quality: BTreeMap<String, f64>,
}

/// A step of the graph and the digest of its artefact.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// The step's name in the graph.
    pub name: String,
    /// Digest of what it made, 64 hexadecimal digits.
    pub artefact: String,
}

/// A golden book.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Book {
    /// Outputs by name.
    pub outputs: Vec<Output>,
    /// Steps in the order of the graph.
    pub steps: Vec<Step>,
}

/// Why a text is no golden book, or a book cannot be written.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum BookError {
    /// Not TOML, or not these keys and types.
    Syntax {
        /// Line of the fault, from 1; 0 if unknown.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// Of another version.
    Format {
        /// The version found.
        found: i64,
    },
    /// An entry holds what it must not.
    Entry {
        /// Its name.
        name: String,
        /// What is wrong.
        reason: String,
    },
}

impl fmt::Display for BookError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            BookError::Syntax { line: 0, reason } => write!(f, "not a golden book: {reason}"),
            BookError::Syntax { line, reason } => write!(f, "not a golden book: line {line}: {reason}"),
            BookError::Format { found } => {
                write!(f, "the golden book has format {found}; this kiln reads format {FORMAT}")
            }
            BookError::Entry { name, reason } => write!(f, "golden entry `{name}`: {reason}"),
        }
    }
}

impl std::error::Error for BookError {}

impl Book {
    /// A book; sorts the outputs, keeps the order of the steps.
    pub fn new(mut outputs: Vec<Output>, steps: Vec<Step>) -> Book {
        outputs.sort_by(|a, b| a.name.cmp(&b.name));
        Book { outputs, steps }
    }

    /// Reads a book.
    pub fn from_toml(text: &str) -> Result<Book, BookError> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct File {
            kiln: i64,
            #[serde(default)]
            output: Vec<Output>,
            #[serde(default)]
            step: Vec<Step>,
        }
        let syntax = |e: toml::de::Error| BookError::Syntax {
            line: e.span().map_or(0, |span| 1 + text.bytes().take(span.start).filter(|b| *b == b'\n').count()),
            reason: e.message().to_string(),
        };
        let file: File = toml::from_str(text).map_err(syntax)?;
        if file.kiln != FORMAT {
            return Err(BookError::Format { found: file.kiln });
        }
        let book = Book::new(file.output, file.step);
        book.check()?;
        Ok(book)
    }

    /// Writes a book; the same book gives the same text.
    pub fn to_toml(&self) -> Result<String, BookError> {
        let book = Book::new(self.outputs.clone(), self.steps.clone());
        book.check()?;
        let mut out = format!("{HEADER}kiln = {FORMAT}\n");
        let text = |s: &str| toml::Value::from(s).to_string();
        for o in &book.outputs {
            let mut line = |key: &str, value: String| {
                // Writing into a String cannot fail.
                let _ = writeln!(out, "{key} = {value}");
            };
            line("\n[[output]]\nname", text(&o.name));
            line("kind", text(o.kind.name()));
            if let Some([w, h]) = o.size {
                line("size", format!("[{w}, {h}]"));
            }
            if let Some(channels) = o.channels {
                line("channels", channels.to_string());
            }
            line("blake3", text(&o.blake3));
            if let Some(Tolerance { max, mean }) = o.tolerance {
                line("tolerance", format!("{{ max = {max:?}, mean = {mean:?} }}"));
            }
            if !o.quality.is_empty() {
                let figures: Vec<String> = o.quality.iter().map(|(k, v)| format!("{} = {v:?}", text(k))).collect();
                line("quality", format!("{{ {} }}", figures.join(", ")));
            }
        }
        for s in &book.steps {
            let _ = write!(out, "\n[[step]]\nname = {}\nartefact = {}\n", text(&s.name), text(&s.artefact));
        }
        Ok(out)
    }

    fn check(&self) -> Result<(), BookError> {
        let fault = |name: &str, reason: String| Err(BookError::Entry { name: name.to_string(), reason });
        let is_digest = |s: &str| s.len() == 64 && s.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
        let digests = self.outputs.iter().map(|o| (&o.name, "blake3", &o.blake3));
        let digests = digests.chain(self.steps.iter().map(|s| (&s.name, "artefact", &s.artefact)));
        for (name, key, digest) in digests {
            if !is_digest(digest) {
                return fault(name, format!("`{key}` is \"{digest}\"; expected 64 hexadecimal digits"));
            }
        }
        if let Some(twice) = self.outputs.windows(2).find(|w| w[0].name == w[1].name) {
            return fault(&twice[0].name, "the output is listed twice".into());
        }
        for output in &self.outputs {
            if let Some(Tolerance { max, mean }) = output.tolerance
                && !(max >= 0.0 && mean >= 0.0 && max.is_finite() && mean.is_finite())
            {
                return fault(&output.name, format!("tolerance max {max}, mean {mean}; expected numbers from 0"));
            }
            if let Some((figure, value)) = output.quality.iter().find(|(_, v)| !v.is_finite()) {
                return fault(&output.name, format!("quality `{figure}` is {value}; expected a finite number"));
            }
        }
        Ok(())
    }

    /// The book to write when `self` is accepted in place of `old`: tolerances are the user's and stay.
    pub fn accepted_over(mut self, old: &Book) -> Book {
        for output in &mut self.outputs {
            let before = old.outputs.iter().find(|o| o.name == output.name);
            output.tolerance = output.tolerance.or(before.and_then(|o| o.tolerance));
        }
        self
    }
}

/// How an output stands to the book.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// As accepted.
    Same,
    /// Not as accepted; whether within the tolerance, only the pixels tell.
    Different {
        /// As accepted.
        expected: Box<Output>,
        /// As it came out.
        actual: Box<Output>,
    },
    /// Accepted once, but not among the outputs now.
    Missing,
    /// Not accepted yet.
    New,
}

/// An output and how it stands to the book.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The output's name.
    pub name: String,
    /// How it stands.
    pub outcome: Outcome,
}

/// Compares what came out with what was accepted: a verdict per output of either, by name.
pub fn compare_book(expected: &Book, actual: &Book) -> Vec<Verdict> {
    let by_name = |book: &Book| -> BTreeMap<String, Output> {
        book.outputs.iter().map(|o| (o.name.clone(), o.clone())).collect()
    };
    let mut before = by_name(expected);
    let mut verdicts = Vec::new();
    for (name, now) in by_name(actual) {
        let shape = |o: &Output| (o.kind, o.size, o.channels, o.blake3.clone());
        let outcome = match before.remove(&name) {
            None => Outcome::New,
            Some(old) if shape(&old) == shape(&now) => Outcome::Same,
            Some(old) => Outcome::Different { expected: Box::new(old), actual: Box::new(now) },
        };
        verdicts.push(Verdict { name, outcome });
    }
    verdicts.extend(before.into_keys().map(|name| Verdict { name, outcome: Outcome::Missing }));
    verdicts.sort_by(|a, b| a.name.cmp(&b.name));
    verdicts
}

/// The first step, in the order of the graph, whose artefact is not the accepted one or that was not there.
pub fn first_differing_step<'a>(expected: &Book, actual: &'a Book) -> Option<&'a Step> {
    actual.steps.iter().find(|step| !expected.steps.contains(step))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digest(c: char) -> String {
        c.to_string().repeat(64)
    }

    fn output(name: &str, c: char) -> Output {
        Output {
            name: name.into(),
            kind: Kind::Map,
            size: Some([64, 32]),
            channels: Some(3),
            blake3: digest(c),
            tolerance: None,
            quality: BTreeMap::new(),
        }
    }

    fn step(name: &str, c: char) -> Step {
        Step { name: name.into(), artefact: digest(c) }
    }

    #[test]
    fn the_layout_is_this() {
        let mut knot = output("knot.base_color.png", 'b');
        knot.tolerance = Some(Tolerance { max: 1.0, mean: 0.25 });
        knot.quality = [("seam".to_string(), 0.5), ("a b".to_string(), 2.0)].into();
        let mesh = Output { kind: Kind::Mesh, size: None, channels: None, ..output("knot.\"glb\"", 'a') };
        let book = Book::new(vec![knot, mesh], vec![step("decode", 'c'), step("analyse", 'd')]);
        let expected = format!(
            r#"{HEADER}kiln = 1

[[output]]
name = 'knot."glb"'
kind = "mesh"
blake3 = "{a}"

[[output]]
name = "knot.base_color.png"
kind = "map"
size = [64, 32]
channels = 3
blake3 = "{b}"
tolerance = {{ max = 1.0, mean = 0.25 }}
quality = {{ "a b" = 2.0, "seam" = 0.5 }}

[[step]]
name = "decode"
artefact = "{c}"

[[step]]
name = "analyse"
artefact = "{d}"
"#,
            a = digest('a'),
            b = digest('b'),
            c = digest('c'),
            d = digest('d')
        );
        assert_eq!(book.to_toml().unwrap(), expected);
        assert_eq!(Book::from_toml(&expected).unwrap(), book);
        assert_eq!(Book::from_toml(&Book::default().to_toml().unwrap()), Ok(Book::default()));
    }

    #[test]
    fn faults_of_a_book_are_sentences() {
        let read = |text: &str| Book::from_toml(text).unwrap_err().to_string();
        assert!(read("kiln = 1\nouput = 3\n").starts_with("not a golden book: line 2: unknown field `ouput`"));
        assert!(read("kiln = 2").contains("format 2; this kiln reads format 1"));
        assert!(read("").contains("missing field `kiln`"));
        let entry = |rest: &str| read(&format!("kiln = 1\n[[output]]\nname = \"n\"\nkind = \"map\"\n{rest}"));
        assert_eq!(entry("blake3 = \"12\""), "golden entry `n`: `blake3` is \"12\"; expected 64 hexadecimal digits");
        let a = digest('a');
        assert!(
            entry(&format!("blake3 = \"{a}\"\ntolerance = {{ max = -1.0, mean = nan }}")).contains("max -1, mean NaN")
        );
        assert!(entry(&format!("blake3 = \"{a}\"\nquality = {{ seam = inf }}")).contains("`seam` is inf"));
        let twice = Book::new(vec![output("n", 'a'), output("n", 'b')], vec![]);
        assert_eq!(twice.to_toml().unwrap_err().to_string(), "golden entry `n`: the output is listed twice");
    }

    #[test]
    fn each_output_of_either_book_gets_a_verdict() {
        let old = Book::new(
            vec![output("same", 'a'), output("other", 'a'), output("gone", 'a'), output("size", 'a')],
            vec![],
        );
        let mut size = output("size", 'a');
        size.size = Some([32, 64]);
        let now = Book::new(vec![output("new", 'a'), output("same", 'a'), output("other", 'b'), size], vec![]);
        let verdicts = compare_book(&old, &now);
        let names: Vec<(&str, &str)> = verdicts
            .iter()
            .map(|v| {
                let outcome = match &v.outcome {
                    Outcome::Same => "same",
                    Outcome::Different { .. } => "different",
                    Outcome::Missing => "missing",
                    Outcome::New => "new",
                };
                (v.name.as_str(), outcome)
            })
            .collect();
        let expected =
            [("gone", "missing"), ("new", "new"), ("other", "different"), ("same", "same"), ("size", "different")];
        assert_eq!(names, expected);
    }

    #[test]
    fn the_first_step_that_went_another_way_is_named() {
        let old = Book::new(vec![], vec![step("decode", 'a'), step("analyse", 'b'), step("walk", 'c')]);
        let now = Book::new(vec![], vec![step("decode", 'a'), step("analyse", 'e'), step("walk", 'f')]);
        assert_eq!(first_differing_step(&old, &now).map(|s| s.name.as_str()), Some("analyse"));
        assert_eq!(first_differing_step(&old, &old), None);
    }

    #[test]
    fn tolerances_survive_acceptance() {
        let tolerance = Tolerance { max: 2.0, mean: 0.1 };
        let old = Book::new(vec![Output { tolerance: Some(tolerance), ..output("a", 'a') }], vec![]);
        let now = Book::new(vec![output("a", 'b'), output("b", 'b')], vec![]).accepted_over(&old);
        assert_eq!(now.outputs[0].tolerance, Some(tolerance));
        assert_eq!(now.outputs[1].tolerance, None);
        let d = |max, mean| Difference { max, mean, differing_share: 1.0, worst: [0, 0] };
        assert!(tolerance.allows(&d(2.0, 0.1)));
        assert!(!tolerance.allows(&d(2.1, 0.1)));
        assert!(!tolerance.allows(&d(2.0, f64::NAN)));
    }
}
