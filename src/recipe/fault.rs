//! What is wrong with a recipe: every fault with its place, what was found, what is allowed and what to do.
//!
//! Printed as compilers do, one block per fault with the line in question, or as one line per fault.

use super::tree::At;
use annotate_snippets::{AnnotationKind, Level, Origin, Renderer, Snippet};
use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

/// A file that can be at fault.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Source {
    pub name: String,
    pub text: String,
}

impl Source {
    /// `file:line:column` of a byte.
    pub fn place(&self, byte: usize) -> String {
        let (line, column) = position(&self.text, byte);
        format!("{}:{line}:{column}", self.name)
    }
}

/// One mistake in a recipe or in `kiln.toml`.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Fault {
    /// The file, as it was given to kiln.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// The bytes of the file that are wrong; empty where something is missing from the whole file.
    pub span: Range<usize>,
    /// The key concerned with its tables, such as `analysis.jumps`; empty for the whole file.
    pub key: String,
    /// What is wrong, as a sentence.
    pub message: String,
    /// What was found, as it would be written.
    pub found: Option<String>,
    /// What is allowed there.
    pub allowed: Option<String>,
    /// What to do about it.
    pub hint: Option<String>,
    #[serde(skip)]
    source: usize,
    /// A second place concerned, in the same file or another.
    #[serde(skip)]
    related: Option<(At, String)>,
    /// The key that was probably meant, with its tables.
    #[serde(skip)]
    meant: Option<String>,
    /// The line is not TOML, so what else is said of it means little.
    #[serde(skip)]
    is_syntax: bool,
}

impl Fault {
    pub(super) fn new(at: At, key: impl Into<String>, message: impl Into<String>) -> Self {
        Fault {
            file: String::new(),
            line: 1,
            column: 1,
            span: at.span,
            key: printable(&key.into()),
            message: message.into(),
            found: None,
            allowed: None,
            hint: None,
            source: at.source,
            related: None,
            meant: None,
            is_syntax: false,
        }
    }

    /// A line that is not TOML.
    pub(super) fn syntax(at: At, message: &str) -> Self {
        Fault { is_syntax: true, ..Fault::new(at, "", format!("not TOML: {message}")) }
    }

    pub(super) fn found(mut self, found: impl Into<String>) -> Self {
        self.found = Some(found.into());
        self
    }

    pub(super) fn allowed(mut self, allowed: impl Into<String>) -> Self {
        self.allowed = Some(allowed.into());
        self
    }

    pub(super) fn hint(mut self, hint: impl Into<Option<String>>) -> Self {
        self.hint = hint.into();
        self
    }

    pub(super) fn meant(mut self, key: Option<String>) -> Self {
        self.meant = key;
        self
    }

    pub(super) fn related(mut self, at: At, label: impl Into<String>) -> Self {
        self.related = Some((at, label.into()));
        self
    }

    /// The fault in a few lines with the place marked, as compilers print it.
    fn render(&self, sources: &[Source], renderer: &Renderer) -> String {
        let title = Level::ERROR.primary_title(self.message.as_str());
        let source = &sources[self.source];
        let group = if self.span == (0..0) {
            title.element(Origin::path(source.name.as_str()))
        } else {
            let label = self.allowed.as_ref().map(|allowed| format!("expected {allowed}"));
            let mark = AnnotationKind::Primary.span(self.span.clone()).label(label);
            let mut snippet = Snippet::source(source.text.as_str()).path(source.name.as_str()).annotation(mark);
            if let Some((at, label)) = self.related.as_ref().filter(|(at, _)| at.source == self.source) {
                let span = first_line(&source.text, &at.span);
                snippet = snippet.annotation(AnnotationKind::Context.span(span).label(label.as_str()));
            }
            title.element(snippet)
        };
        let group = match self.related.as_ref().filter(|(at, _)| at.source != self.source) {
            Some((at, label)) => {
                let (line, _) = position(&sources[at.source].text, at.span.start);
                group.element(Level::NOTE.message(format!("{label} in {}:{line}", sources[at.source].name)))
            }
            None => group,
        };
        let group = match &self.hint {
            Some(hint) => group.element(Level::HELP.message(hint.as_str())),
            None => group,
        };
        renderer.render(&[group])
    }
}

/// One line: `file:line:column: message: expected ...; hint`.
impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}:{}:{}: {}", self.file, self.line, self.column, self.message)?;
        if let Some(allowed) = &self.allowed {
            write!(f, ": expected {allowed}")?;
        }
        if let Some(hint) = &self.hint {
            write!(f, "; {hint}")?;
        }
        Ok(())
    }
}

/// Everything that is wrong with a recipe, in the order of the file; at least one fault.
#[derive(Clone, Debug, PartialEq)]
pub struct Faults {
    sources: Vec<Source>,
    list: Vec<Fault>,
    more: usize,
}

impl Faults {
    /// The faults, those of `kiln.toml` last.
    pub fn iter(&self) -> impl Iterator<Item = &Fault> {
        self.list.iter()
    }

    /// How many there are, including those that [`Faults::iter`] leaves out because there are too many.
    pub fn count(&self) -> usize {
        self.list.len() + self.more
    }

    /// A block for each fault, as compilers print them, an empty line between them and a line feed at the end; with
    /// the escape sequences of colours if `colour` says so.
    pub fn render(&self, colour: bool) -> String {
        let renderer = if colour { Renderer::styled() } else { Renderer::plain() }.term_width(TERMINAL_WIDTH);
        let mut blocks: Vec<_> = self.list.iter().map(|fault| fault.render(&self.sources, &renderer)).collect();
        if self.more > 0 {
            blocks.push(format!("... and {} more", self.more));
        }
        blocks.join("\n\n") + "\n"
    }
}

/// One line per fault.
impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for (i, fault) in self.list.iter().enumerate() {
            write!(f, "{}{fault}", if i == 0 { "" } else { "\n" })?;
        }
        if self.more > 0 { write!(f, "\n... and {} more", self.more) } else { Ok(()) }
    }
}

impl std::error::Error for Faults {}

/// Wider lines of a recipe are cut around the fault.
const TERMINAL_WIDTH: usize = 120;
/// Nobody reads more; a file of a mebibyte could have half a million.
const MOST_FAULTS: usize = 100;

/// Faults as they are found.
#[derive(Default)]
pub(super) struct Findings {
    list: Vec<Fault>,
    more: usize,
}

impl Findings {
    pub fn push(&mut self, fault: Fault) {
        if self.list.len() < MOST_FAULTS { self.list.push(fault) } else { self.more += 1 }
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Reports a fault, unless it only follows from one of `keys` having been found wrong or misspelled before.
    pub fn push_unless_due_to(&mut self, keys: &[&str], fault: Fault) {
        let is_or_is_in = |fault: &Fault, key: &str| {
            let rest = fault.key.strip_prefix(key);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
                || fault.meant.as_deref() == Some(key)
        };
        let is_full = self.list.len() >= MOST_FAULTS;
        if is_full || !self.list.iter().any(|fault| keys.iter().any(|key| is_or_is_in(fault, key))) {
            self.push(fault);
        }
    }

    /// Sorts the faults by place and gives them line numbers. Of a line that is not TOML only that is said, once.
    pub fn finish(mut self, sources: Vec<Source>) -> Faults {
        self.list.sort_by_key(|f| (f.source, f.span.start));
        for fault in &mut self.list {
            let source = &sources[fault.source];
            fault.file.clone_from(&source.name);
            fault.span = first_line(&source.text, &fault.span);
            (fault.line, fault.column) = position(&source.text, fault.span.start);
        }
        let mut broken = BTreeMap::new();
        for fault in self.list.iter().filter(|fault| fault.is_syntax) {
            broken.entry((fault.source, fault.line)).or_insert(fault.span.start);
        }
        self.list.retain(|fault| match broken.get(&(fault.source, fault.line)) {
            Some(&first) => fault.is_syntax && fault.span.start == first,
            None => true,
        });
        Faults { sources, list: self.list, more: self.more }
    }
}

/// The part of a span that lies on its first line, at character boundaries.
fn first_line(text: &str, span: &Range<usize>) -> Range<usize> {
    let start = boundary(text, span.start);
    let end = boundary(text, span.end).max(start);
    let line = text[start..end].find(['\n', '\r']).map_or(end, |i| start + i);
    // The line feed itself can be what is wrong.
    start..if line == start { end.min(start + 1) } else { line }
}

/// The last character boundary up to a byte.
fn boundary(text: &str, byte: usize) -> usize {
    (0..=byte.min(text.len())).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0)
}

/// Line and column, from 1, of a byte at a character boundary.
fn position(text: &str, byte: usize) -> (usize, usize) {
    let before = &text[..boundary(text, byte)];
    let line_start = before.rfind('\n').map_or(0, |i| i + 1);
    (before.bytes().filter(|&b| b == b'\n').count() + 1, before[line_start..].chars().count() + 1)
}

/// Text from a recipe as it may go to a terminal: control characters escaped, the middle of long text left out.
pub(super) fn printable(text: &str) -> String {
    const LONGEST: usize = 60;
    let escaped = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    if text.chars().count() <= LONGEST {
        return text.chars().map(escaped).collect();
    }
    let head: String = text.chars().take(LONGEST - 20).map(escaped).collect();
    let tail: Vec<char> = text.chars().rev().take(15).collect();
    head + "..." + &tail.into_iter().rev().map(escaped).collect::<String>()
}

/// `a`, `b` and `c`, each in `quotes`, joined by `last_word`.
pub(super) fn listing(items: &[impl AsRef<str>], quote: &str, last_word: &str) -> String {
    let quoted: Vec<String> = items.iter().map(|item| format!("{quote}{}{quote}", item.as_ref())).collect();
    match &quoted[..] {
        [] => String::new(),
        [only] => only.clone(),
        [first @ .., last] => format!("{} {last_word} {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(text: &str, span: Range<usize>) -> Faults {
        let mut findings = Findings::default();
        let at = At { source: 0, span };
        findings.push(Fault::new(at, "k", "`k` can't be 0").found("0").allowed("1").hint("write 1".to_string()));
        findings.finish(vec![Source { name: "a.toml".into(), text: text.into() }])
    }

    #[test]
    fn places_count_lines_and_characters() {
        assert_eq!(position("a\nü x", 5), (2, 3));
        let faults = one("ü = 1\nkü = 0\n", 13..14);
        assert_eq!(faults.to_string(), "a.toml:2:6: `k` can't be 0: expected 1; write 1");
        let expected = "\
error: `k` can't be 0
 --> a.toml:2:6
  |
2 | kü = 0
  |      ^ expected 1
  |
  = help: write 1
";
        assert_eq!(faults.render(false), expected);
        assert!(faults.render(true).contains("\x1b["));
    }

    #[test]
    fn spans_are_cut_to_what_can_be_shown() {
        assert_eq!(first_line("ab\ncd", &(1..5)), 1..2);
        assert_eq!(first_line("ab\ncd", &(2..5)), 2..3);
        assert_eq!(first_line("aü", &(2..9)), 1..3);
        assert_eq!(first_line("aü", &(0..2)), 0..1);
        assert_eq!(first_line("", &(7..9)), 0..0);
        for span in [0..0, 0..1, 2..3, 6..6, 6..7] {
            assert!(one("k = 0\n", span).render(false).starts_with("error: `k` can't be 0\n"));
        }
    }

    #[test]
    fn what_goes_to_a_terminal_is_harmless_and_short() {
        assert_eq!(printable("a\u{1b}[2Jb"), "a\\u{1b}[2Jb");
        assert_eq!(printable(&"x".repeat(1000)).len(), 58);
        assert_eq!(listing(&["a", "b", "c"], "`", "or"), "`a`, `b` or `c`");
    }
}
