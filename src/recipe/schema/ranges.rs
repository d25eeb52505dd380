//! What the JSON Schema says of values beyond their types.

use schemars::Schema;
use serde::Serialize;
use std::ops::RangeInclusive;

/// Sets the range of a number.
pub(super) fn within<T: Serialize>(range: RangeInclusive<T>) -> impl FnMut(&mut Schema) {
    move |schema| {
        schema.insert("minimum".into(), serde_json::json!(range.start()));
        schema.insert("maximum".into(), serde_json::json!(range.end()));
    }
}

/// Sets the range of each number of an array.
pub(super) fn each<T: Serialize>(range: RangeInclusive<T>) -> impl FnMut(&mut Schema) {
    let mut inner = within(range);
    move |schema| {
        if let Some(items) = schema.get_mut("items").and_then(|items| items.try_into().ok()) {
            inner(items);
        }
    }
}

/// Odd numbers only.
pub(super) fn odd(schema: &mut Schema) {
    schema.insert("not".into(), serde_json::json!({ "multipleOf": 2 }));
}

/// Odd numbers only, in an array.
pub(super) fn each_odd(schema: &mut Schema) {
    if let Some(items) = schema.get_mut("items").and_then(|items| items.try_into().ok()) {
        odd(items);
    }
}

/// At least one item or character.
pub(super) fn filled(schema: &mut Schema) {
    let key = if schema.get("items").is_some() { "minItems" } else { "minLength" };
    schema.insert(key.into(), 1.into());
}
