//! The shape of a recipe: unknown keys, wrong types, words and ranges, missing keys; all of them at once.
//!
//! Checks a tree against the JSON Schema that the serde types give, so that editors, faults and the reader cannot
//! disagree. Understands the part of JSON Schema that occurs there: `$ref`, `allOf` of one, `anyOf`, `oneOf`, `type`,
//! `const`, `enum`, `minimum`, `maximum`, `not: { multipleOf }`, lengths, `properties`, `required`, `items`.
//! What is wrong is taken out of the tree, so that the rest can be read and checked further.
//! Unaware of: which keys go together, which features exist.

use super::fault::{Fault, Findings, listing, printable};
use super::hint;
use super::json_schema::RECIPE;
use super::tree::{At, Entry, Node, Table, Value};
use serde_json::Value as Json;

/// Whether a missing key is a fault. Defaults, and what is left of a file with syntax errors, need not be whole.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Whole {
    Required,
    Partial,
}

/// Checks `root` against `schema`, takes out what is wrong and reports it.
pub(super) fn check(root: &mut Node, schema: &Json, whole: Whole, findings: &mut Findings) {
    let mut walk = Walk { schema, whole, findings };
    walk.node(root, &leaves(schema, schema), "");
}

struct Walk<'a> {
    schema: &'a Json,
    whole: Whole,
    findings: &'a mut Findings,
}

impl<'a> Walk<'a> {
    /// True if the value may stay.
    fn node(&mut self, node: &mut Node, allowed: &[&'a Json], path: &str) -> bool {
        let at = node.at.clone();
        match &mut node.value {
            Value::Table(table) => {
                if let Some(leaf) = of_type(allowed, &["object"]) {
                    self.table(table, leaf, &at, path);
                    return true;
                }
            }
            Value::Array(items) => {
                if let Some(leaf) = of_type(allowed, &["array"]) {
                    return self.array(items, leaf, &at, path);
                }
            }
            scalar => {
                if scalar_fits(scalar, allowed) {
                    return true;
                }
            }
        }
        self.wrong_value(node, allowed, path);
        false
    }

    fn table(&mut self, table: &mut Table, leaf: &'a Json, at: &At, path: &str) {
        let known = &leaf["properties"];
        table.retain(|key, entry| {
            let path = join(path, key);
            match known.get(key) {
                Some(schema) => self.node(&mut entry.node, &leaves(self.schema, schema), &path),
                None => {
                    self.unknown_key(key, entry, leaf, &path);
                    false
                }
            }
        });
        let required = leaf["required"].as_array().into_iter().flatten().filter_map(Json::as_str);
        if self.whole == Whole::Required {
            for key in required.filter(|&key| !table.contains_key(key)) {
                let full = join(path, key);
                let wanted = leaves(self.schema, &known[key]);
                let fault = |what| Fault::new(at.clone(), &full, format!("{} needs {what}", table_name(path)));
                let fault = match of_type(&wanted, &["object"]) {
                    Some(_) => fault(format!("a table [{key}]")),
                    None => fault(format!("a key `{key}`")).allowed(allowed_text(&wanted)),
                };
                self.findings.push_unless_due_to(&[&full], fault);
            }
        }
    }

    fn array(&mut self, items: &mut [Node], leaf: &'a Json, at: &At, path: &str) -> bool {
        let wanted = leaves(self.schema, &leaf["items"]);
        let (least, most) = (leaf["minItems"].as_u64(), leaf["maxItems"].as_u64());
        let count = items.len() as u64;
        if least.is_some_and(|least| count < least) || most.is_some_and(|most| count > most) {
            let message = format!("`{path}` has {count} {}", if count == 1 { "value" } else { "values" });
            let found = format!("{count} values");
            self.findings.push(Fault::new(at.clone(), path, message).found(found).allowed(allowed_text(&[leaf])));
            return false;
        }
        let mut good = true;
        for (i, item) in items.iter_mut().enumerate() {
            good &= self.node(item, &wanted, &format!("{path}[{i}]"));
        }
        good
    }

    fn unknown_key(&mut self, key: &str, entry: &Entry, leaf: &Json, path: &str) {
        let keys: Vec<&str> = leaf["properties"].as_object().into_iter().flatten().map(|(k, _)| k.as_str()).collect();
        let parent = path.strip_suffix(key).unwrap_or(path).trim_end_matches('.');
        let near = hint::nearest(key, keys.iter().copied());
        let elsewhere = tables_with(&hint::plain(key), parent);
        let mut hints = Vec::new();
        hints.extend(near.map(|near| format!("did you mean `{near}`?")));
        if !elsewhere.is_empty() {
            let key = hint::known_name(key).unwrap_or(key);
            hints.push(format!("`{}` belongs in {}", printable(key), listing(&elsewhere, "", "or")));
        }
        if hints.is_empty() {
            let taker = if parent.is_empty() { "the file".into() } else { table_name(parent) };
            hints.push(format!("{taker} takes {}", listing(&keys, "`", "and")));
        }
        let shown = printable(key);
        let message = match entry.node.value {
            Value::Table(_) if parent.is_empty() => format!("unknown table [{shown}]"),
            _ if parent.is_empty() => format!("unknown key `{shown}` outside of any table"),
            _ => format!("unknown key `{shown}` in {}", table_name(parent)),
        };
        self.findings.push(
            Fault::new(entry.key.clone(), path, message)
                .found(printable(key))
                .hint(hints.join(" "))
                .meant(near.map(|near| join(parent, near))),
        );
    }

    fn wrong_value(&mut self, node: &Node, allowed: &[&Json], path: &str) {
        let found = describe(&node.value);
        let message = format!("`{path}` can't be {found}");
        self.findings.push(
            Fault::new(node.at.clone(), path, message)
                .found(found)
                .allowed(allowed_text(allowed))
                .hint(wrong_value_hint(&node.value, allowed, path)),
        );
    }
}

/// The alternatives of a schema, without references and nesting.
fn leaves<'a>(root: &'a Json, schema: &'a Json) -> Vec<&'a Json> {
    if let Some(name) = schema["$ref"].as_str().and_then(|r| r.strip_prefix("#/definitions/")) {
        return leaves(root, &root["definitions"][name]);
    }
    for group in ["allOf", "anyOf", "oneOf"] {
        if let Some(choices) = schema[group].as_array() {
            return choices.iter().flat_map(|choice| leaves(root, choice)).collect();
        }
    }
    vec![schema]
}

fn of_type<'a>(leaves: &[&'a Json], types: &[&str]) -> Option<&'a Json> {
    leaves.iter().copied().find(|leaf| leaf["type"].as_str().is_some_and(|t| types.contains(&t)))
}

/// The words that are allowed, if the schema is a list of words.
fn words<'a>(leaves: &[&'a Json]) -> Vec<&'a str> {
    let of_leaf = |leaf: &'a Json| leaf.get("const").into_iter().chain(leaf["enum"].as_array().into_iter().flatten());
    leaves.iter().flat_map(|leaf| of_leaf(leaf)).filter_map(Json::as_str).collect()
}

fn scalar_fits(value: &Value, allowed: &[&Json]) -> bool {
    match value {
        Value::Boolean(_) => of_type(allowed, &["boolean"]).is_some(),
        Value::String(s) => {
            let words = words(allowed);
            let long_enough = |leaf: &Json| s.chars().count() as u64 >= leaf["minLength"].as_u64().unwrap_or(0);
            if words.is_empty() {
                of_type(allowed, &["string"]).is_some_and(long_enough)
            } else {
                words.contains(&s.as_str())
            }
        }
        Value::Integer(i) => of_type(allowed, &["integer", "number"]).is_some_and(|leaf| integer_fits(*i, leaf)),
        Value::Float(f) => of_type(allowed, &["number"]).is_some_and(|leaf| {
            let least = leaf["minimum"].as_f64().unwrap_or(f64::MIN);
            (least..=leaf["maximum"].as_f64().unwrap_or(f64::MAX)).contains(f)
        }),
        Value::Date(_) | Value::Array(_) | Value::Table(_) => false,
    }
}

fn integer_fits(i: i128, leaf: &Json) -> bool {
    let one_of = leaf.get("const").into_iter().chain(leaf["enum"].as_array().into_iter().flatten());
    let numbers: Vec<i128> = one_of.filter_map(Json::as_i64).map(i128::from).collect();
    // Whole bounds exactly; bounds with a fraction only occur where fractions are allowed.
    let above = match (leaf["minimum"].as_i64(), leaf["minimum"].as_f64()) {
        (Some(least), _) => i >= i128::from(least),
        (None, Some(least)) => i as f64 >= least,
        (None, None) => true,
    };
    let below = match (leaf["maximum"].as_i64(), leaf["maximum"].as_f64()) {
        (Some(most), _) => i <= i128::from(most),
        (None, Some(most)) => i as f64 <= most,
        (None, None) => true,
    };
    let odd = leaf["not"]["multipleOf"].as_i64().is_none_or(|n| i % i128::from(n) != 0);
    above && below && odd && (numbers.is_empty() || numbers.contains(&i))
}

/// A value as it would be written, shortened.
pub(super) fn describe(value: &Value) -> String {
    match value {
        Value::String(s) => format!("\"{}\"", printable(s)),
        Value::Integer(i128::MIN | i128::MAX) => "a number of more than 38 digits".into(),
        Value::Integer(i) => i.to_string(),
        Value::Float(f) if f.is_finite() => format!("{f:?}"),
        Value::Float(f) => f.to_string().to_lowercase(),
        Value::Boolean(b) => b.to_string(),
        Value::Date(d) => format!("the date {d}"),
        Value::Array(items) if items.iter().any(|item| item.table().is_some()) => "an array of tables".into(),
        Value::Array(_) => "an array".into(),
        Value::Table(_) => "a table".into(),
    }
}

/// What a schema allows, in words that follow "expected".
pub(super) fn allowed_text(leaves: &[&Json]) -> String {
    let mut texts = Vec::new();
    for leaf in leaves {
        match (leaf["enum"].as_array(), leaf.get("const")) {
            (Some(values), _) => texts.extend(values.iter().map(Json::to_string)),
            (None, Some(value)) => texts.push(value.to_string()),
            (None, None) => texts.push(leaf_text(leaf)),
        }
    }
    listing(&texts, "", "or")
}

fn leaf_text(leaf: &Json) -> String {
    let range = match (leaf["minimum"].as_f64(), leaf["maximum"].as_f64()) {
        (Some(least), Some(most)) => format!(" from {} to {}", bound(least), bound(most)),
        (Some(least), None) => format!(" of at least {}", bound(least)),
        _ => String::new(),
    };
    match leaf["type"].as_str().unwrap_or_default() {
        "integer" if leaf["not"]["multipleOf"] == 2 => format!("an odd whole number{range}"),
        "integer" => format!("a whole number{range}"),
        "number" => format!("a number{range}"),
        "boolean" => "true or false".into(),
        "string" if leaf["minLength"].is_u64() => "text in quotes, not empty".into(),
        "string" => "text in quotes".into(),
        "object" => "a table".into(),
        "array" => array_text(leaf),
        other => other.into(),
    }
}

fn array_text(leaf: &Json) -> String {
    let item = match leaves(&RECIPE, &leaf["items"])[..] {
        [only] if only["type"] == "object" => return "an array of tables".into(),
        ref leaves => allowed_text(leaves),
    };
    match (leaf["minItems"].as_u64(), leaf["maxItems"].as_u64()) {
        (Some(least), Some(most)) if least == most => format!("an array of {most} values, each {item}"),
        (Some(least), Some(most)) => format!("an array of {least} to {most} values, each {item}"),
        (Some(_), None) => format!("an array of at least one value, each {item}"),
        _ => format!("an array of values, each {item}"),
    }
}

/// A bound as a person would write it.
fn bound(x: f64) -> String {
    if x == i64::MAX as f64 {
        i64::MAX.to_string() // which a float can't tell exactly
    } else if x != 0.0 && !(1e-3..1e6).contains(&x.abs()) {
        format!("{x:e}")
    } else {
        x.to_string()
    }
}

/// How to write what was probably meant.
fn wrong_value_hint(value: &Value, allowed: &[&Json], path: &str) -> Option<String> {
    let own_table = !path.contains(['.', '[']);
    match value {
        Value::String(s) if !words(allowed).is_empty() => {
            hint::nearest(s, words(allowed)).map(|near| format!("did you mean \"{near}\"?"))
        }
        Value::String(s) => {
            let unquoted = if s == "true" || s == "false" { Value::Boolean(s == "true") } else { number(s)? };
            scalar_fits(&unquoted, allowed).then(|| format!("write it without quotes: {s}"))
        }
        Value::Float(f) if f.fract() == 0.0 && scalar_fits(&Value::Integer(*f as i128), allowed) => {
            Some(format!("write it without a fraction: {f}"))
        }
        Value::Integer(_) | Value::Float(_) if words(allowed).is_empty() && of_type(allowed, &["string"]).is_some() => {
            Some("write it in quotes".into())
        }
        Value::Array(_) if own_table && of_type(allowed, &["object"]).is_some() => Some(format!("write [{path}]")),
        Value::Table(_) if own_table && of_type(allowed, &["array"]).is_some() => Some(format!("write [[{path}]]")),
        Value::Integer(_) | Value::Float(_) | Value::Boolean(_) => of_type(allowed, &["array"])
            .filter(|leaf| scalar_fits(value, &leaves(&RECIPE, &leaf["items"])))
            .filter(|leaf| leaf["minItems"].as_u64().is_none_or(|least| least <= 1))
            .map(|_| format!("write it in brackets: [{}]", describe(value))),
        _ => None,
    }
}

fn number(text: &str) -> Option<Value> {
    text.parse().map(Value::Integer).or_else(|_| text.parse().map(Value::Float)).ok()
}

/// The tables other than `here` that have a key, as `[name]`.
fn tables_with(key: &str, here: &str) -> Vec<String> {
    let key = hint::known_name(key).unwrap_or(key);
    let top = RECIPE["properties"].as_object().into_iter().flatten();
    let mut found: Vec<String> = Vec::new();
    for (name, schema) in top.clone() {
        let own = leaves(&RECIPE, schema);
        let array = of_type(&own, &["array"]).map(|leaf| leaves(&RECIPE, &leaf["items"]));
        let has = |leaves: &[&Json]| of_type(leaves, &["object"]).is_some_and(|t| t["properties"].get(key).is_some());
        if has(&own) && here != name {
            found.push(format!("[{name}]"));
        } else if array.is_some_and(|items| has(&items)) && !here.starts_with(name.as_str()) {
            found.push(format!("[[{name}]]"));
        }
    }
    if !here.is_empty() && top.clone().any(|(name, _)| name == key) {
        found.push("the top level of the recipe".into());
    }
    found
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.into() } else { format!("{path}.{key}") }
}

/// A table as its header is written.
fn table_name(path: &str) -> String {
    match path.split_once('[') {
        _ if path.is_empty() => "the recipe".into(),
        Some((name, index)) if !name.contains('.') && index.ends_with(']') && !index.contains('.') => {
            format!("[[{name}]]")
        }
        None => format!("[{path}]"),
        Some(_) => format!("`{path}`"),
    }
}
