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
#   tolerance = { share = 0.001, flip = 0.01 }    # share of the texels that differ; difference to the eye, 0 to 1
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
    /// The word for it.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Map => "map",
            Kind::Render => "render",
            Kind::Mesh => "mesh",
            Kind::File => "file",
        }
    }
}

/// How far an image may be from the accepted one: by every figure that is given, and at least one is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tolerance {
    /// Greatest difference of a sample, in the units of [`Difference`].
    pub max: Option<f64>,
    /// Mean difference over all samples.
    pub mean: Option<f64>,
    /// Share of the texels of which any sample differs, 0..=1.
    pub share: Option<f64>,
    /// Difference to the eye, 0..=1: see [`super::flip`].
    pub flip: Option<f64>,
}

impl Tolerance {
    /// True if the difference, and `flip` to the eye, are within the tolerance.
    pub fn allows(&self, difference: &Difference, flip: f64) -> bool {
        let found = [difference.max, difference.mean, difference.differing_share, flip];
        self.limits().iter().zip(found).all(|((_, limit), found)| limit.is_none_or(|limit| found <= limit))
    }

    fn limits(&self) -> [(&'static str, Option<f64>); 4] {
        [("max", self.max), ("mean", self.mean), ("share", self.share), ("flip", self.flip)]
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
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// The step's name in the graph.
    pub name: String,
    /// Digest of what it made, 64 hexadecimal digits.
    pub artefact: String,
    /// The revision of its code; older books lack it and what follows.
    pub revision: Option<u32>,
    /// Its parameters as the engine shows them.
    #[serde(default)]
    pub params: BTreeMap<String, String>,
    /// Digests of the files that it reads itself, by path.
    #[serde(default)]
    pub files: BTreeMap<String, String>,
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
            if let Some(tolerance) = o.tolerance {
                let limits = tolerance.limits().into_iter().filter_map(|(k, v)| Some(format!("{k} = {:?}", v?)));
                line("tolerance", format!("{{ {} }}", limits.collect::<Vec<_>>().join(", ")));
            }
            if !o.quality.is_empty() {
                let figures: Vec<String> = o.quality.iter().map(|(k, v)| format!("{} = {v:?}", text(k))).collect();
                line("quality", format!("{{ {} }}", figures.join(", ")));
            }
        }
        for s in &book.steps {
            let _ = write!(out, "\n[[step]]\nname = {}\nartefact = {}\n", text(&s.name), text(&s.artefact));
            if let Some(revision) = s.revision {
                let _ = writeln!(out, "revision = {revision}");
            }
            for (key, values) in [("params", &s.params), ("files", &s.files)] {
                if !values.is_empty() {
                    let values: Vec<String> =
                        values.iter().map(|(k, v)| format!("{} = {}", text(k), text(v))).collect();
                    let _ = writeln!(out, "{key} = {{ {} }}", values.join(", "));
                }
            }
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
            let limits = output.tolerance.map(|t| t.limits());
            if limits.is_some_and(|l| l.iter().all(|(_, limit)| limit.is_none())) {
                return fault(&output.name, "`tolerance` is empty; expected `max`, `mean`, `share` or `flip`".into());
            }
            let known = limits.into_iter().flatten().filter_map(|(key, limit)| Some((key, limit?)));
            for (key, limit) in known {
                if !(limit >= 0.0 && limit.is_finite()) {
                    return fault(&output.name, format!("tolerance `{key}` is {limit}; expected a number from 0"));
                }
            }
            if let Some((figure, value)) = output.quality.iter().find(|(_, v)| !v.is_finite()) {
                return fault(&output.name, format!("quality `{figure}` is {value}; expected a finite number"));
            }
        }
        Ok(())
    }

    /// The book to write when the outputs that `is_accepted` names take the place of those of `old`: tolerances are the
    /// user's and stay. Steps tell where what is not accepted went another way, so they stay as long as there is any.
    pub fn accepted_over(&self, old: &Book, is_accepted: impl Fn(&str) -> bool) -> Book {
        let (mut outputs, mut is_whole) = (Vec::new(), true);
        for Verdict { name, outcome } in compare_book(old, self) {
            let [before, now] = [old, self].map(|book| book.output(&name).cloned());
            is_whole &= outcome == Outcome::Same || is_accepted(&name);
            let kept = if outcome == Outcome::Same || is_accepted(&name) { now } else { before.clone() };
            let tolerance = before.and_then(|o| o.tolerance);
            outputs.extend(kept.map(|output| Output { tolerance: output.tolerance.or(tolerance), ..output }));
        }
        Book::new(outputs, if is_whole { self.steps.clone() } else { old.steps.clone() })
    }

    /// The output of a name.
    pub fn output(&self, name: &str) -> Option<&Output> {
        self.outputs.iter().find(|o| o.name == name)
    }

    /// The step of a name.
    pub fn step(&self, name: &str) -> Option<&Step> {
        self.steps.iter().find(|s| s.name == name)
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
        Step { name: name.into(), artefact: digest(c), ..Step::default() }
    }

    #[test]
    fn the_layout_is_this() {
        let mut knot = output("knot.base_color.png", 'b');
        knot.tolerance = Some(Tolerance { max: Some(1.0), mean: Some(0.25), ..Tolerance::default() });
        knot.quality = [("seam".to_string(), 0.5), ("a b".to_string(), 2.0)].into();
        let mesh = Output { kind: Kind::Mesh, size: None, channels: None, ..output("knot.\"glb\"", 'a') };
        let analyse = Step {
            revision: Some(3),
            params: [("jumps".to_string(), "3".to_string()), ("window size".into(), "\"a\"".into())].into(),
            files: [("assets/moss.png".to_string(), digest('e'))].into(),
            ..step("analyse", 'd')
        };
        let book = Book::new(vec![knot, mesh], vec![step("decode", 'c'), analyse]);
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
revision = 3
params = {{ "jumps" = "3", "window size" = '"a"' }}
files = {{ "assets/moss.png" = "{e}" }}
"#,
            a = digest('a'),
            b = digest('b'),
            c = digest('c'),
            d = digest('d'),
            e = digest('e')
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
        let tolerance = |limits: &str| entry(&format!("blake3 = \"{a}\"\ntolerance = {{ {limits} }}"));
        assert!(tolerance("max = -1.0, mean = 1").contains("`max` is -1; expected a number from 0"));
        assert!(tolerance("flip = nan").contains("`flip` is NaN"));
        assert!(tolerance("").contains("`tolerance` is empty"));
        assert!(tolerance("mox = 1").contains("unknown field `mox`"));
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
    fn tolerances_survive_acceptance() {
        let tolerance = Tolerance { max: Some(2.0), mean: Some(0.1), ..Tolerance::default() };
        let old = Book::new(vec![Output { tolerance: Some(tolerance), ..output("a", 'a') }], vec![]);
        let now = Book::new(vec![output("a", 'b'), output("b", 'b')], vec![]).accepted_over(&old, |_| true);
        assert_eq!(now.outputs[0].tolerance, Some(tolerance));
        assert_eq!(now.outputs[1].tolerance, None);
    }

    #[test]
    fn a_tolerance_holds_by_each_of_its_figures() {
        let d = |max, mean, differing_share| Difference { max, mean, differing_share, worst: [0, 0] };
        let limits = [Some(2.0), Some(0.1), Some(0.5), Some(0.05)];
        let [max, mean, share, flip] = limits;
        let all = Tolerance { max, mean, share, flip };
        assert!(all.allows(&d(2.0, 0.1, 0.5), 0.05));
        for (difference, flip) in [
            (d(2.1, 0.1, 0.5), 0.05),
            (d(2.0, f64::NAN, 0.5), 0.05),
            (d(2.0, 0.1, 0.51), 0.05),
            (d(2.0, 0.1, 0.5), 0.06),
        ] {
            assert!(!all.allows(&difference, flip), "{difference:?}");
        }
        let eye = Tolerance { flip, ..Tolerance::default() };
        assert!(eye.allows(&d(255.0, 99.0, 1.0), 0.05) && !eye.allows(&d(0.1, 0.1, 0.1), 0.06));
    }

    #[test]
    fn outputs_are_accepted_one_by_one() {
        let old = Book::new(vec![output("a", 'a'), output("b", 'a'), output("gone", 'a')], vec![step("walk", 'a')]);
        let now = Book::new(vec![output("a", 'b'), output("b", 'b'), output("new", 'b')], vec![step("walk", 'b')]);
        let part = now.accepted_over(&old, |name| name == "a");
        let digests = |book: &Book| -> Vec<(String, String)> {
            book.outputs.iter().map(|o| (o.name.clone(), o.blake3[..1].to_string())).collect()
        };
        let pairs = |of: [(&str, &str); 3]| of.map(|(n, d)| (n.to_string(), d.to_string()));
        assert_eq!(digests(&part), pairs([("a", "b"), ("b", "a"), ("gone", "a")]));
        assert_eq!(part.steps, old.steps, "the rest is still to be explained");
        let rest = now.accepted_over(&part, |name| name != "a");
        assert_eq!((digests(&rest), &rest.steps), (pairs([("a", "b"), ("b", "b"), ("new", "b")]).to_vec(), &now.steps));
        let without_gone = now.accepted_over(&old, |name| name != "gone");
        assert!(without_gone.output("gone").is_some() && without_gone.steps == old.steps);
    }
}
