//! Reference data as JSON: one reader for the tests of all crates, which take this file in by its path.
#![allow(dead_code, reason = "each test binary uses its own part")]

use serde_json::Value;

/// A file in a folder of our own, or in the subfolder `reference` of the one that `SINEW_REFERENCE` names.
pub fn load(own: &str, file: &str) -> Value {
    let named = std::env::var("SINEW_REFERENCE").map(|root| format!("{root}/reference"));
    let path = format!("{}/{file}", named.unwrap_or_else(|_| own.into()));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{path}: {e}"))
}

pub fn number(v: &Value) -> f64 {
    v.as_f64().unwrap_or_else(|| panic!("number expected, found {v}"))
}

fn items(v: &Value) -> impl Iterator<Item = &Value> {
    v.as_array().unwrap_or_else(|| panic!("list expected, found {v}")).iter()
}

pub fn numbers(v: &Value) -> Vec<f64> {
    items(v).map(number).collect()
}

pub fn list(v: &Value) -> Vec<u32> {
    items(v).map(|i| i.as_u64().expect("index") as u32).collect()
}

pub fn indices<const N: usize>(v: &Value) -> Vec<[u32; N]> {
    items(v).map(|c| list(c).try_into().expect("as many indices")).collect()
}

/// A nested list, row after row.
pub fn flat(v: &Value) -> Vec<f64> {
    match v.as_array() {
        Some(rows) => rows.iter().flat_map(flat).collect(),
        None => vec![number(v)],
    }
}

/// A list of so many rows of so many numbers.
pub fn rows<const N: usize, const M: usize>(v: &Value) -> [[f64; M]; N] {
    let rows: Vec<[f64; M]> = items(v).map(|r| flat(r).try_into().expect("a row")).collect();
    rows.try_into().expect("as many rows")
}

/// Points, in the plane `z = 0` where they have two coordinates.
pub fn points(v: &Value) -> Vec<[f64; 3]> {
    let point = |p: &Value| [number(&p[0]), number(&p[1]), p.get(2).map_or(0.0, number)];
    items(v).map(point).collect()
}
