//! A TOML file as a tree whose keys and values know where they were written, and the merge of two of them.
//!
//! In: text. Out: the tree, with whatever syntax errors there are; the parts without errors are there all the same.
//! Unaware of: what the keys mean.

use super::fault::printable;
use std::collections::BTreeMap;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Where something was written: which file of a recipe's sources, and which bytes of it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct At {
    pub source: usize,
    pub span: Range<usize>,
}

/// A value and where it is.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub at: At,
    pub value: Value,
}

/// The entries of a table, sorted by key.
pub(super) type Table = BTreeMap<String, Entry>;

/// A key and its value.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub key: At,
    pub node: Node,
}

/// A TOML value. An integer too large for even 128 bits is the largest of its sign.
#[derive(Clone, Debug)]
pub(super) enum Value {
    String(String),
    Integer(i128),
    Float(f64),
    Boolean(bool),
    Date(String),
    Array(Vec<Node>),
    Table(Table),
}

/// A syntax error: what the TOML reader said, and where.
#[derive(Debug)]
pub(super) struct SyntaxError {
    pub message: String,
    pub at: At,
}

/// Reads a file as a table. The errors are in the order of the file, at most one per line: one slip often breaks a
/// line in several ways, and the first says most.
pub(super) fn read(source: usize, text: &str) -> (Node, Vec<SyntaxError>) {
    let (root, mut found) = DeTable::parse_recoverable(text);
    found.sort_by_key(|e| e.span().map(|span| span.start));
    let mut errors: Vec<SyntaxError> = Vec::new();
    let mut line_end = None;
    for e in &found {
        let span = e.span().unwrap_or(0..0);
        if line_end.is_some_and(|end| span.start <= end) {
            continue;
        }
        let mut message = e.message().trim().replace('\n', ", ");
        if message == "duplicate key" {
            // After a broken header it is not known which table the next ones belong to.
            let is_header = text.get(..span.start).is_some_and(|before| before.ends_with('['));
            if is_header && !errors.is_empty() {
                continue;
            }
            message = format!("{message} `{}`", printable(text.get(span.clone()).unwrap_or_default()));
        }
        line_end = text.get(span.start..).map(|rest| span.start + rest.find('\n').unwrap_or(rest.len()));
        errors.push(SyntaxError { message, at: At { source, span } });
    }
    (Node { at: At { source, span: 0..0 }, value: Value::Table(table(source, root.get_ref())) }, errors)
}

/// What the reader made up in place of a broken value has no place, and is left out.
fn table(source: usize, from: &DeTable) -> Table {
    from.iter()
        .filter(|(_, value)| value.get_ref().is_table() || !value.span().is_empty())
        .map(|(key, value)| {
            let entry = Entry { key: At { source, span: key.span() }, node: node(source, value) };
            (key.get_ref().to_string(), entry)
        })
        .collect()
}

fn node(source: usize, from: &Spanned<DeValue>) -> Node {
    let value = match from.get_ref() {
        DeValue::String(s) => Value::String(s.to_string()),
        DeValue::Integer(i) => {
            let largest = if i.as_str().starts_with('-') { i128::MIN } else { i128::MAX };
            Value::Integer(i128::from_str_radix(i.as_str(), i.radix()).unwrap_or(largest))
        }
        DeValue::Float(f) => Value::Float(f.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(b) => Value::Boolean(*b),
        DeValue::Datetime(d) => Value::Date(d.to_string()),
        DeValue::Array(items) => {
            Value::Array(items.iter().filter(|item| !item.span().is_empty()).map(|item| node(source, item)).collect())
        }
        DeValue::Table(t) => Value::Table(table(source, t)),
    };
    Node { at: At { source, span: from.span() }, value }
}

impl Node {
    /// The entries, if this is a table.
    pub fn table(&self) -> Option<&Table> {
        match &self.value {
            Value::Table(table) => Some(table),
            _ => None,
        }
    }

    /// The entries, if this is a table.
    pub fn table_mut(&mut self) -> Option<&mut Table> {
        match &mut self.value {
            Value::Table(table) => Some(table),
            _ => None,
        }
    }

    /// The entry of a dotted path of tables, such as `atlas.size`.
    pub fn entry(&self, path: &str) -> Option<&Entry> {
        match path.split_once('.') {
            Some((first, rest)) => self.table()?.get(first)?.node.entry(rest),
            None => self.table()?.get(path),
        }
    }

    /// Where a path is written, such as `field.orientation[1].up`; if it is not, where the nearest thing around it is.
    pub fn locate(&self, path: &str) -> At {
        let mut node = self;
        for step in path.split(['.', '[', ']']).filter(|step| !step.is_empty()) {
            let next = match &node.value {
                Value::Table(table) => table.get(step).map(|entry| &entry.node),
                Value::Array(items) => step.parse::<usize>().ok().and_then(|i| items.get(i)),
                _ => None,
            };
            match next {
                Some(next) => node = next,
                None => break,
            }
        }
        node.at.clone()
    }

    /// Puts `other` under this table: keys that are here stay, tables are merged key by key, arrays are not.
    pub fn merge_under(&mut self, other: &Table) {
        let Some(table) = self.table_mut() else { return };
        for (key, theirs) in other {
            match (table.get_mut(key), &theirs.node.value) {
                (None, _) => _ = table.insert(key.clone(), theirs.clone()),
                (Some(ours), Value::Table(below)) => ours.node.merge_under(below),
                (Some(_), _) => {}
            }
        }
    }

    /// The value for serde.
    pub fn to_toml(&self) -> toml::Value {
        match &self.value {
            Value::String(s) | Value::Date(s) => toml::Value::String(s.clone()),
            Value::Integer(i) => i64::try_from(*i).map_or(toml::Value::Float(*i as f64), toml::Value::Integer),
            Value::Float(f) => toml::Value::Float(*f),
            Value::Boolean(b) => toml::Value::Boolean(*b),
            Value::Array(items) => toml::Value::Array(items.iter().map(Node::to_toml).collect()),
            Value::Table(t) => {
                toml::Value::Table(t.iter().map(|(key, entry)| (key.clone(), entry.node.to_toml())).collect())
            }
        }
    }
}

/// Says of everything in a table that it was written in another source.
pub(super) fn renumber(table: &mut Table, source: usize) {
    for entry in table.values_mut() {
        entry.key.source = source;
        renumber_node(&mut entry.node, source);
    }
}

fn renumber_node(node: &mut Node, source: usize) {
    node.at.source = source;
    match &mut node.value {
        Value::Table(table) => renumber(table, source),
        Value::Array(items) => items.iter_mut().for_each(|item| renumber_node(item, source)),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_lead_to_what_was_written_or_to_what_is_around_it() {
        let text = "a = 1\n[b]\nc = [10, { d = 2 }]\n";
        let (root, errors) = read(0, text);
        assert!(errors.is_empty());
        let at = |path| &text[root.locate(path).span];
        assert_eq!(at("a"), "1");
        assert_eq!(at("b.c[0]"), "10");
        assert_eq!(at("b.c[1].d"), "2");
        assert_eq!(at("b.c[1].e"), "{ d = 2 }");
        assert_eq!(at("b.x"), "[b]");
        assert_eq!(at("x"), "");
    }

    #[test]
    fn what_is_written_stays_over_what_is_merged_under_it() {
        let (mut ours, _) = read(0, "x = 1\nlist = [1]\n[t]\na = 1\n");
        let (theirs, _) = read(1, "x = 2\nlist = [2, 3]\ny = 5\n[t]\na = 2\nb = 3\n");
        ours.merge_under(theirs.table().expect("a table"));
        let merged = ours.to_toml();
        assert_eq!(merged, toml::from_str("x = 1\nlist = [1]\ny = 5\nt = { a = 1, b = 3 }").expect("valid"));
        assert_eq!(ours.entry("t.b").expect("merged").key.source, 1);
    }

    #[test]
    fn broken_lines_leave_the_others_readable() {
        let (root, errors) = read(0, "a = 1\nb = = 2\na = 3\nc = 4\n");
        let places: Vec<_> = errors.iter().map(|e| e.at.span.start).collect();
        assert_eq!(places, [10, 14], "{errors:?}");
        assert!(root.entry("c").is_some() && root.entry("b").is_none());
        assert!(matches!(
            read(0, "i = 999999999999999999999999999999999999999999").0.entry("i"),
            Some(Entry { node: Node { value: Value::Integer(i128::MAX), .. }, .. })
        ));
    }
}
