//! The JSON schema of scene files. The reader itself is asked: what it says of a key that it does not know, and of a value
//! that it does not take, names keys, choices and types. So no list can fall behind it.

use crate::scene::Scene;
use serde_json::{Map, Value, json};

/// A word that is no key and no choice.
const NOTHING: &str = "no_such_word";
/// Tables within tables that are looked into at most.
const DEPTH: usize = 8;

/// What the reader says of a scene.
fn said(text: &str) -> String {
    toml::from_str::<Scene>(text).err().map_or(String::new(), |error| error.message().to_string())
}

/// The names that a message lists, after the one that it is about.
fn listed(message: &str) -> Vec<String> {
    message.split('`').skip(3).step_by(2).map(str::to_owned).collect()
}

/// What may stand at a place; `scene` makes a scene of a value there.
fn value(scene: &dyn Fn(&str) -> String, depth: usize) -> Value {
    let refused = said(&scene(&format!("\"{NOTHING}\"")));
    let table = said(&scene(&format!("{{ {NOTHING} = 0 }}")));
    let keys = if table.starts_with("unknown field") { listed(&table) } else { Vec::new() };
    if !keys.is_empty() && depth < DEPTH {
        return object(scene, &keys, depth);
    }
    if refused.starts_with("unknown variant") {
        return choice(scene, &listed(&refused), depth);
    }
    let Some(wanted) =
        refused.split("expected ").nth(1).filter(|_| refused.starts_with("invalid type"))
    else {
        // a text is taken, or only together with what else there is
        let text = refused.is_empty() || refused.starts_with("missing field");
        return if text { json!({ "type": "string" }) } else { json!({}) };
    };
    match wanted {
        "f64" | "f32" => json!({ "type": "number" }),
        "u8" | "u16" | "u32" | "u64" | "usize" => json!({ "type": "integer", "minimum": 0 }),
        "a boolean" => json!({ "type": "boolean" }),
        _ if depth < DEPTH
            && (wanted.starts_with("a sequence") || wanted.starts_with("an array")) =>
        {
            let mut list = json!({ "type": "array" });
            list["items"] = value(&|inner| scene(&format!("[{inner}]")), depth + 1);
            if let Some(count) = wanted.rsplit(' ').next().and_then(|n| n.parse::<u64>().ok()) {
                (list["minItems"], list["maxItems"]) = (count.into(), count.into());
            }
            list
        }
        _ => json!({}),
    }
}

/// A table with these keys.
fn object(scene: &dyn Fn(&str) -> String, keys: &[String], depth: usize) -> Value {
    let of = |key: &String| {
        let within = |inner: &str| scene(&format!("{{ {key} = {inner} }}"));
        (key.clone(), value(&within, depth + 1))
    };
    let properties: Map<String, Value> = keys.iter().map(of).collect();
    json!({ "type": "object", "properties": properties, "additionalProperties": false })
}

/// One of these words, or a table with one of them and what belongs to it.
fn choice(scene: &dyn Fn(&str) -> String, words: &[String], depth: usize) -> Value {
    let plain = |word: &&String| !said(&scene(&format!("\"{word}\""))).starts_with("invalid type");
    let alone: Vec<&String> = words.iter().filter(plain).collect();
    let with: Vec<String> = words.iter().filter(|word| !plain(word)).cloned().collect();
    let alone_schema = json!({ "enum": alone });
    if with.is_empty() || depth >= DEPTH {
        return alone_schema;
    }
    let tables = object(scene, &with, depth);
    if alone.is_empty() { tables } else { json!({ "anyOf": [alone_schema, tables] }) }
}

/// The schema.
///
/// ```
/// let schema = sinew_scene::schema::schema();
/// let body = &schema["properties"]["body"]["items"]["properties"];
/// assert_eq!(body["material"]["properties"]["young_modulus"]["type"], "number");
/// ```
pub fn schema() -> Value {
    let top = said(&format!("{NOTHING} = 0"));
    let of = |key: String| {
        let schema = value(&|inner| format!("{key} = {inner}"), 0);
        (key, schema)
    };
    let properties: Map<String, Value> = listed(&top).into_iter().map(of).collect();
    json!({
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Scene of Sinew",
        "type": "object",
        "properties": properties,
        "required": ["name"],
        "additionalProperties": false,
    })
}
