//! What a check found, as a page for people and as JUnit XML for build servers.
//!
//! The page is one file that loads nothing: styles inline, pictures as data URIs. Nothing in either depends on the time
//! or the machine.

use super::base64;
use crate::io::Pixels;
use crate::io::image_file::{Compression, Transfer, encode_png};
use std::fmt::Write;

/// How a check of one output ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// As accepted.
    Same,
    /// Different, but within the tolerance.
    Tolerated,
    /// Different.
    Different,
    /// Accepted once, but not among the outputs now.
    Missing,
    /// Not accepted yet.
    New,
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
            Status::Failed => "failed",
        }
    }
}

/// The check of one output.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The recipe's name.
    pub recipe: String,
    /// The output's name.
    pub output: String,
    /// How it ended.
    pub status: Status,
    /// Figures, the first step that differs, the command that accepts: one line each.
    pub message: String,
    /// Expected, difference and actual (see [`super::compare::triptych`]), or only what there is.
    pub picture: Option<Pixels>,
}

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;margin:2em auto;max-width:1100px;padding:0 1em;\
color:#222;background:#fafafa}section{border-top:1px solid #ccc;padding:.6em 0}h2{font-size:1em;margin:.3em 0}\
b{border-radius:3px;padding:0 .4em;color:#fff;background:#2a7d3c}b.fail{background:#b3261e}\
pre{white-space:pre-wrap;margin:.3em 0}img{max-width:100%;image-rendering:pixelated}\
@media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}}";

/// A page with every entry: failures first, then the others, each in the order given.
pub fn html(entries: &[Entry]) -> String {
    let failed = entries.iter().filter(|e| e.status.is_failure()).count();
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>kiln check</title>\
         <style>{STYLE}</style></head>\n<body><h1>kiln check</h1>\n<p>{} outputs, {failed} failed.</p>\n",
        entries.len()
    );
    let (failures, rest): (Vec<&Entry>, Vec<&Entry>) = entries.iter().partition(|e| e.status.is_failure());
    for e in failures.into_iter().chain(rest) {
        let class = if e.status.is_failure() { " class=\"fail\"" } else { "" };
        // Writing into a String cannot fail.
        let (status, recipe, output) = (e.status.name(), escape(&e.recipe), escape(&e.output));
        let _ = writeln!(out, "<section><h2><b{class}>{status}</b> {recipe} / {output}</h2>");
        if !e.message.is_empty() {
            let _ = writeln!(out, "<pre>{}</pre>", escape(&e.message));
        }
        let png = e.picture.as_ref().and_then(|p| encode_png(p, Compression::Fast, Transfer::Srgb).ok());
        if let Some(png) = png {
            let _ = writeln!(
                out,
                "<img alt=\"expected, difference, actual\" src=\"data:image/png;base64,{}\">",
                base64::encode(&png)
            );
        }
        out.push_str("</section>\n");
    }
    out.push_str("</body></html>\n");
    out
}

/// JUnit XML: a suite per recipe, a case per output. Entries of one recipe stand together.
pub fn junit(entries: &[Entry]) -> String {
    let count = |entries: &[Entry]| {
        let failed = entries.iter().filter(|e| e.status.is_failure()).count();
        format!("tests=\"{}\" failures=\"{failed}\"", entries.len())
    };
    let mut out =
        format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"kiln check\" {}>\n", count(entries));
    for suite in entries.chunk_by(|a, b| a.recipe == b.recipe) {
        let recipe = escape(&suite[0].recipe);
        let _ = writeln!(out, "  <testsuite name=\"{recipe}\" {}>", count(suite));
        for e in suite {
            let case = format!("    <testcase classname=\"{recipe}\" name=\"{}\"", escape(&e.output));
            let _ = if e.status.is_failure() {
                let (status, text) = (e.status.name(), escape(&e.message));
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

/// Text for XML and HTML, in and outside of attributes. Characters that XML 1.0 does not allow become U+FFFD.
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

    fn entries() -> Vec<Entry> {
        let entry = |recipe: &str, output: &str, status, message: &str| Entry {
            recipe: recipe.into(),
            output: output.into(),
            status,
            message: message.into(),
            picture: None,
        };
        let picture = Pixels { width: 2, height: 1, channels: 3, samples: Samples::U8(vec![1; 6]) };
        vec![
            entry("knot", "a.png", Status::Same, ""),
            Entry { picture: Some(picture), ..entry("knot", "b<&\">.png", Status::Different, "max 3 < 4\u{1b}") },
            entry("spot", "c.png", Status::Tolerated, "close"),
        ]
    }

    #[test]
    fn junit_is_this() {
        let expected = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>
<testsuites name=\"kiln check\" tests=\"3\" failures=\"1\">
  <testsuite name=\"knot\" tests=\"2\" failures=\"1\">
    <testcase classname=\"knot\" name=\"a.png\"/>
    <testcase classname=\"knot\" name=\"b&lt;&amp;&quot;&gt;.png\">
      <failure message=\"different\">max 3 &lt; 4\u{fffd}</failure>
    </testcase>
  </testsuite>
  <testsuite name=\"spot\" tests=\"1\" failures=\"0\">
    <testcase classname=\"spot\" name=\"c.png\"/>
  </testsuite>
</testsuites>
";
        assert_eq!(junit(&entries()), expected);
    }

    #[test]
    fn the_page_holds_everything_and_loads_nothing() {
        let page = html(&entries());
        assert!(page.contains("3 outputs, 1 failed."));
        let (bad, good) = (page.find("b&lt;&amp;&quot;&gt;.png").unwrap(), page.find("a.png").unwrap());
        assert!(bad < good, "failures come first");
        assert_eq!(page.matches("src=\"").count(), page.matches("src=\"data:image/png;base64,iVBOR").count());
        assert_eq!(page.matches("src=\"").count(), 1);
        for outside in ["http", "url(", "<script", "<link"] {
            assert!(!page.contains(outside), "{outside}");
        }
        assert_eq!(page.matches("<section>").count(), page.matches("</section>").count());
    }
}
