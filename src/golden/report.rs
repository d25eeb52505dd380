//! What a check found: for people as a page, for build servers as JUnit XML, for programs as JSON.
//!
//! The page is one file that loads nothing: styles and script inline, pictures as data URIs, what was found as the JSON
//! of [`json()`] with pictures. The JSON is a contract, raised to another version when a field changes its meaning or goes:
//!
//! ```json
//! {"version": 1, "seconds": 1.5,
//!  "outputs": [{"recipe": "knot", "output": "knot.base_color.png", "kind": "map", "status": "different",
//!    "message": "differs by at most ...", "accept": "kiln accept knot/knot.base_color.png",
//!    "figures": {"max": 3.0, "mean": 0.1, "share": 0.02, "flip": 0.01, "worst": [5, 7]},
//!    "quality": {"swd": {"before": 20.1, "after": 19.0}},
//!    "first_change": {"step": "analyse", "reasons": ["`jumps` changed from 3 to 4"]}}],
//!  "recipes": [{"recipe": "knot", "seconds": 1.2, "steps": [{"step": "analyse", "seconds": 0.5}]}]}
//! ```
//!
//! `status` is one of [`Status::name`]; what is not known is null or empty. Unaware of: files, how things are compared.

use super::base64;
use super::change::Change;
use crate::io::Pixels;
use crate::io::image_file::{Compression, Transfer, encode_png};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;

/// How a check of one output ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// As accepted.
    #[default]
    Same,
    /// Different, but within the tolerance.
    Tolerated,
    /// Different.
    Different,
    /// Accepted once, but not among the outputs now.
    Missing,
    /// Not accepted yet.
    New,
    /// A golden of a recipe that is gone.
    Stale,
    /// Another process made something else of the same inputs.
    Unstable,
    /// The recipe could not be baked.
    Failed,
}

impl Status {
    /// True if the check fails by it: everything but what is as accepted or tolerated.
    pub fn is_failure(self) -> bool {
        !matches!(self, Status::Same | Status::Tolerated)
    }

    /// The word for it.
    pub fn name(self) -> &'static str {
        match self {
            Status::Same => "same",
            Status::Tolerated => "tolerated",
            Status::Different => "different",
            Status::Missing => "missing",
            Status::New => "new",
            Status::Stale => "stale",
            Status::Unstable => "unstable",
            Status::Failed => "failed",
        }
    }
}

/// How much two images differ: see [`super::compare::Difference`] and [`super::flip`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Greatest difference of a sample.
    pub max: f64,
    /// Mean difference.
    pub mean: f64,
    /// Share of the texels that differ, 0..=1.
    pub share: f64,
    /// Difference to the eye, 0..=1.
    pub flip: f64,
    /// Column and row of the greatest difference.
    pub worst: [u32; 2],
}

/// What there is to look at, of one size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pictures {
    /// As accepted.
    pub expected: Option<Pixels>,
    /// As it is now.
    pub actual: Option<Pixels>,
    /// Their difference, amplified.
    pub difference: Option<Pixels>,
}

/// The check of one output.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Entry {
    /// The recipe's name.
    pub recipe: String,
    /// The output's name.
    pub output: String,
    /// What it is, in a word.
    pub kind: &'static str,
    /// How it ended.
    pub status: Status,
    /// What was found, in words; one line each.
    pub message: String,
    /// How much it differs, if it is an image and what was accepted is here.
    pub figures: Option<Figures>,
    /// Figures of quality by name: as accepted and now.
    pub quality: BTreeMap<String, (Option<f64>, Option<f64>)>,
    /// The first step that went another way.
    pub change: Option<Change>,
    /// The command that accepts it; empty if there is none.
    pub accept: String,
    /// What can be shown.
    pub pictures: Pictures,
}

impl Entry {
    /// Everything there is to say of it in words: what was found, where it began, what it did to the quality, and the
    /// command that accepts it.
    pub fn told(&self) -> String {
        let mut lines: Vec<String> = self.message.lines().map(String::from).collect();
        lines.extend(self.change.as_ref().map(first_step));
        lines.extend(moved(&self.quality));
        // What is stale is not accepted but removed, and says so.
        let is_acceptable = !self.accept.is_empty() && self.status != Status::Stale;
        lines.extend(is_acceptable.then(|| format!("accept it by: {}", self.accept)));
        lines.join("\n")
    }
}

/// The first step that differs, and why, in a line.
pub fn first_step(change: &Change) -> String {
    let why = if change.reasons.is_empty() { String::new() } else { format!(": {}", change.reasons.join("; ")) };
    format!("first step that differs: {}{why}", change.step)
}

/// A line for each figure of quality that moved: lower is better.
pub fn moved(quality: &BTreeMap<String, (Option<f64>, Option<f64>)>) -> Vec<String> {
    let line = |(name, values): (&String, &(Option<f64>, Option<f64>))| match values {
        (Some(a), Some(b)) if a == b => None,
        (Some(a), Some(b)) => Some(format!("{name} {a} -> {b}: {}", if b < a { "better" } else { "worse" })),
        (None, Some(b)) => Some(format!("{name} {b}")),
        _ => None,
    };
    quality.iter().filter_map(line).collect()
}

/// How long a recipe took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Times {
    /// The recipe's name.
    pub recipe: String,
    /// Seconds of each of its steps, in the order of the graph; one that recipes share counts for the first.
    pub steps: Vec<(String, f64)>,
}

impl Times {
    fn seconds(&self) -> f64 {
        self.steps.iter().map(|(_, s)| s).sum()
    }
}

/// Everything that a check found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Findings {
    /// The outputs; those of one recipe stand together.
    pub entries: Vec<Entry>,
    /// How long recipes took.
    pub times: Vec<Times>,
    /// How long the bake took, in seconds.
    pub seconds: f64,
}

/// The page's parts around its data.
const PAGE: &str = include_str!("page.html");
const MARK: &str = "@DATA@";

/// A page to look through the findings.
pub fn html(findings: &Findings) -> String {
    // In a script element only `<` can do harm.
    let data = document(findings, true).to_string().replace('<', "\\u003c");
    let (head, tail) = PAGE.split_once(MARK).unwrap_or((PAGE, ""));
    [head, &data, tail].concat()
}

/// The findings without their pictures (see the module's text for its fields).
pub fn json(findings: &Findings) -> Value {
    document(findings, false)
}

fn document(findings: &Findings, with_pictures: bool) -> Value {
    let output = |e: &Entry| {
        let quality: BTreeMap<&str, Value> = e
            .quality
            .iter()
            .map(|(name, (before, after))| (name.as_str(), json!({"before": before, "after": after})))
            .collect();
        let mut output = json!({
            "recipe": e.recipe,
            "output": e.output,
            "kind": e.kind,
            "status": e.status.name(),
            "message": e.message,
            "accept": e.accept,
            "figures": e.figures.map(|Figures { max, mean, share, flip, worst }| {
                json!({"max": max, "mean": mean, "share": share, "flip": flip, "worst": worst})
            }),
            "quality": quality,
            "first_change": e.change.as_ref().map(|c| json!({"step": c.step, "reasons": c.reasons})),
        });
        if with_pictures {
            let Pictures { expected, actual, difference } = &e.pictures;
            let [expected, actual, difference] = [expected, actual, difference].map(|p| p.as_ref().and_then(data_uri));
            output["failed"] = e.status.is_failure().into();
            output["pictures"] = json!({"expected": expected, "actual": actual, "difference": difference});
        }
        output
    };
    let recipe = |t: &Times| {
        let steps = t.steps.iter().map(|(step, seconds)| json!({"step": step, "seconds": seconds}));
        json!({"recipe": t.recipe, "seconds": t.seconds(), "steps": steps.collect::<Vec<_>>()})
    };
    json!({
        "version": 1,
        "seconds": findings.seconds,
        "outputs": findings.entries.iter().map(output).collect::<Vec<_>>(),
        "recipes": findings.times.iter().map(recipe).collect::<Vec<_>>(),
    })
}

fn data_uri(pixels: &Pixels) -> Option<String> {
    let png = encode_png(pixels, Compression::Fast, Transfer::Srgb).ok()?;
    Some(format!("data:image/png;base64,{}", base64::encode(&png)))
}

/// JUnit XML: a suite per recipe, a case per output. Entries of one recipe stand together.
pub fn junit(findings: &Findings) -> String {
    let count = |entries: &[Entry], seconds: f64| {
        let failed = entries.iter().filter(|e| e.status.is_failure()).count();
        format!("tests=\"{}\" failures=\"{failed}\" time=\"{seconds:.3}\"", entries.len())
    };
    let entries = &findings.entries;
    let total = count(entries, findings.seconds);
    let mut out = format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"kiln check\" {total}>\n");
    for suite in entries.chunk_by(|a, b| a.recipe == b.recipe) {
        let times = findings.times.iter().find(|t| t.recipe == suite[0].recipe);
        let seconds = times.map_or(0.0, Times::seconds);
        let recipe = escape(&suite[0].recipe);
        // Writing into a String cannot fail.
        let _ = writeln!(out, "  <testsuite name=\"{recipe}\" {}>", count(suite, seconds));
        for e in suite {
            let case = format!("    <testcase classname=\"{recipe}\" name=\"{}\"", escape(&e.output));
            let _ = if e.status.is_failure() {
                let (status, text) = (e.status.name(), escape(&e.told()));
                writeln!(out, "{case}>\n      <failure message=\"{status}\">{text}</failure>\n    </testcase>")
            } else {
                writeln!(out, "{case}/>")
            };
        }
        out.push_str("  </testsuite>\n");
    }
    out.push_str("</testsuites>\n");
    out
}

/// Text for XML, in and outside of attributes. Characters that XML 1.0 does not allow become U+FFFD.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(c),
            '\0'..='\u{1f}' | '\u{fffe}' | '\u{ffff}' => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Samples;

    fn findings() -> Findings {
        let entry = |recipe: &str, output: &str, status, message: &str| Entry {
            recipe: recipe.into(),
            output: output.into(),
            status,
            message: message.into(),
            ..Entry::default()
        };
        let picture = Pixels { width: 2, height: 1, channels: 3, samples: Samples::U8(vec![1; 6]) };
        let entries = vec![
            entry("knot", "a.png", Status::Same, ""),
            Entry {
                pictures: Pictures { actual: Some(picture), ..Pictures::default() },
                figures: Some(Figures { max: 3.0, mean: 0.5, share: 0.25, flip: 0.125, worst: [5, 7] }),
                quality: [("swd".to_string(), (Some(20.5), Some(19.0)))].into(),
                accept: "kiln accept knot".into(),
                change: Some(Change { step: "analyse".into(), reasons: vec!["why".into()], is_unexplained: false }),
                ..entry("knot", "b</script>&\".png", Status::Different, "max 3 < 4\u{1b}")
            },
            entry("spot", "c.png", Status::Tolerated, "close"),
        ];
        let steps = vec![("maps".to_string(), 0.25), ("analyse".to_string(), 1.0)];
        Findings { entries, times: vec![Times { recipe: "knot".into(), steps }], seconds: 1.5 }
    }

    #[test]
    fn junit_is_this() {
        let expected = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>
<testsuites name=\"kiln check\" tests=\"3\" failures=\"1\" time=\"1.500\">
  <testsuite name=\"knot\" tests=\"2\" failures=\"1\" time=\"1.250\">
    <testcase classname=\"knot\" name=\"a.png\"/>
    <testcase classname=\"knot\" name=\"b&lt;/script&gt;&amp;&quot;.png\">
      <failure message=\"different\">max 3 &lt; 4\u{fffd}
first step that differs: analyse: why
swd 20.5 -&gt; 19: better
accept it by: kiln accept knot</failure>
    </testcase>
  </testsuite>
  <testsuite name=\"spot\" tests=\"1\" failures=\"0\" time=\"0.000\">
    <testcase classname=\"spot\" name=\"c.png\"/>
  </testsuite>
</testsuites>
";
        assert_eq!(junit(&findings()), expected);
    }

    #[test]
    fn figures_that_moved_are_better_or_worse() {
        let both = |pairs: &[(&str, Option<f64>, Option<f64>)]| {
            moved(&pairs.iter().map(|(n, a, b)| (n.to_string(), (*a, *b))).collect())
        };
        let said = both(&[
            ("a", Some(2.0), Some(1.5)),
            ("b", Some(2.0), Some(2.0)),
            ("c", Some(1.0), Some(3.0)),
            ("d", None, Some(4.0)),
            ("e", Some(4.0), None),
        ]);
        assert_eq!(said, ["a 2 -> 1.5: better", "c 1 -> 3: worse", "d 4"]);
    }

    #[test]
    fn json_has_what_its_text_says() {
        let found = json(&findings());
        let output = &found["outputs"][1];
        assert_eq!(output["figures"]["flip"], 0.125);
        assert_eq!(output["quality"]["swd"], json!({"before": 20.5, "after": 19.0}));
        assert_eq!(output["first_change"], json!({"step": "analyse", "reasons": ["why"]}));
        assert_eq!(found["recipes"][0]["steps"][1], json!({"step": "analyse", "seconds": 1.0}));
        assert!(output["pictures"].is_null() && found["outputs"][0]["figures"].is_null());
    }

    #[test]
    fn the_page_holds_everything_and_loads_nothing() {
        assert_eq!(PAGE.matches(MARK).count(), 1);
        let page = html(&findings());
        assert!(page.contains("data:image/png;base64,iVBOR"));
        assert!(!page.contains("b</script>") && page.contains("b\\u003c/script>"), "names cannot end the data");
        for outside in ["http", "url(", "<link", "src=\"", "import", "fetch"] {
            assert!(!page.contains(outside), "{outside}");
        }
        // The data is JSON as it stands.
        let data = page.split("type=\"application/json\">").nth(1).and_then(|s| s.split("</script>").next()).unwrap();
        let data: Value = serde_json::from_str(data).unwrap();
        assert_eq!(data["outputs"][1]["output"], "b</script>&\".png");
    }
}
