//! The JSON Schema of a recipe: what editors complete from, and what [`super::shape`] checks against.
//!
//! Draft 7, which the TOML language servers read. Since TOML has no null, nothing of what schemars says about null is
//! kept; neither are `format`s, which are names of Rust types.

use super::schema;
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::Value;
use std::sync::LazyLock;

/// Schema of a recipe.
pub(super) static RECIPE: LazyLock<Value> = LazyLock::new(of::<schema::Recipe>);
/// Schema of `kiln.toml`.
pub(super) static PROJECT: LazyLock<Value> = LazyLock::new(of::<schema::Project>);

/// The JSON Schema (draft 7) of a recipe, indented, with a line feed at the end.
pub fn json_schema() -> String {
    format!("{:#}\n", *RECIPE)
}

fn of<T: JsonSchema>() -> Value {
    let mut schema = SchemaSettings::draft07().into_generator().into_root_schema_for::<T>().to_value();
    tidy(&mut schema);
    schema
}

/// Takes out nulls, formats and the default `null`.
fn tidy(schema: &mut Value) {
    match schema {
        Value::Array(items) => items.iter_mut().for_each(tidy),
        Value::Object(keys) => {
            keys.values_mut().for_each(tidy);
            keys.retain(|key, value| {
                !(key == "format" && value.is_string() || key == "default" && (value.is_null() || value.is_object()))
            });
            if let Some(Value::Array(types)) = keys.get_mut("type") {
                types.retain(|name| name != "null");
                if let [only] = &types[..] {
                    let only = only.clone();
                    keys.insert("type".into(), only);
                }
            }
            if let Some(Value::Array(mut choices)) = keys.remove("anyOf") {
                choices.retain(|choice| choice["type"] != "null");
                let key = if choices.len() == 1 { "allOf" } else { "anyOf" };
                keys.insert(key.into(), choices.into());
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_schema_describes_every_key_and_knows_no_null() {
        let text = json_schema();
        assert!(!text.contains("null") && !text.contains("uint32"), "{text}");
        let synthesis = &RECIPE["definitions"]["Synthesis"]["properties"];
        assert_eq!(synthesis["seed"]["default"], 1);
        assert_eq!(synthesis["blend"]["default"], "linear");
        assert_eq!(RECIPE["definitions"]["Analysis"]["properties"]["jumps"]["maximum"], 64);
        assert_eq!(RECIPE["definitions"]["Mesh"]["required"], serde_json::json!(["path"]));
        for (name, definition) in RECIPE["definitions"].as_object().expect("definitions") {
            for (key, property) in definition["properties"].as_object().into_iter().flatten() {
                assert!(property["description"].is_string(), "{name}.{key} has no description");
            }
            if definition["type"] == "object" {
                assert_eq!(definition["additionalProperties"], false, "{name}");
            }
        }
    }
}
