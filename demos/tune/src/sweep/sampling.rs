//! Values of parameters: lists, ranges, grids, latin hypercubes, cells of a list of runs.

use super::hash::Hash;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A range of values.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValueRange {
    /// Its lower end.
    pub min: f64,
    /// Its upper end.
    pub max: f64,
    /// Points of a grid.
    pub count: Option<usize>,
    /// How they are spread.
    #[serde(default)]
    pub scale: RangeScale,
}

/// How values are spread over a range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RangeScale {
    /// Evenly.
    #[default]
    Linear,
    /// Their logarithms evenly.
    Log,
}

/// Values of a parameter.
#[derive(Clone, Debug)]
pub enum Axis {
    /// These.
    Values(Vec<Value>),
    /// Numbers of a range.
    Range {
        /// The range.
        range: ValueRange,
        /// Whole numbers only.
        whole: bool,
    },
}

impl Axis {
    /// How its values are spread, where a range says so.
    pub fn scale(&self) -> Option<RangeScale> {
        match self {
            Self::Values(_) => None,
            Self::Range { range, .. } => Some(range.scale),
        }
    }

    /// Points of a grid.
    pub fn points(&self) -> Vec<Value> {
        match self {
            Self::Values(values) => values.clone(),
            Self::Range { range, .. } => {
                let last = range.count.unwrap_or(2) - 1;
                (0..=last).map(|i| self.at(i as f64 / last as f64)).collect()
            }
        }
    }

    /// Value at a share of the range, from 0 to 1.
    pub fn at(&self, share: f64) -> Value {
        match self {
            Self::Values(values) => {
                let index = (share * values.len() as f64) as usize;
                values[index.min(values.len() - 1)].clone()
            }
            Self::Range { range: ValueRange { min, max, scale, .. }, whole } => {
                let value = match scale {
                    _ if share <= 0.0 => *min,
                    _ if share >= 1.0 => *max,
                    RangeScale::Linear => min + (max - min) * share,
                    // the same bits on every machine
                    RangeScale::Log => {
                        libm::exp(libm::log(*min) * (1.0 - share) + libm::log(*max) * share)
                    }
                };
                if *whole { (value.round() as i64).into() } else { value.into() }
            }
        }
    }
}

/// Runs of a grid, so many: the first parameter varies slowest.
pub fn grid_runs(lists: &[Vec<Value>], count: usize) -> Vec<Vec<Value>> {
    let run = |mut index: usize| {
        let mut values = vec![Value::Null; lists.len()];
        for (value, list) in values.iter_mut().zip(lists).rev() {
            *value = list[index % list.len()].clone();
            index /= list.len();
        }
        values
    };
    (0..count).map(run).collect()
}

/// Runs of a latin hypercube: each parameter has its range cut into as many equal parts as there are runs, and visits each part once, in an
/// order of its own (McKay, Beckman, Conover 1979). Its order depends on the seed and its name alone.
pub fn hypercube_runs(axes: &[Axis], names: &[String], count: usize, seed: u64) -> Vec<Vec<Value>> {
    let mut runs = vec![Vec::with_capacity(axes.len()); count];
    for (axis, name) in axes.iter().zip(names) {
        let start = Hash::of(seed.to_le_bytes()).and(name).short();
        let mut random = SplitMix(u64::from_str_radix(&start, 16).unwrap_or(seed));
        let mut parts: Vec<usize> = (0..count).collect();
        for i in (1..count).rev() {
            parts.swap(i, random.below(i + 1));
        }
        for (run, part) in runs.iter_mut().zip(parts) {
            run.push(axis.at((part as f64 + random.unit()) / count as f64));
        }
    }
    runs
}

/// The splitmix64 sequence.
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 to below 1.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A whole number below `n`.
    fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.next()) * n as u128) >> 64) as usize
    }
}

/// A cell by its looks; a word where the scene has a word.
pub fn cell_value(cell: &str, present: &Value) -> Value {
    if cell.is_empty() {
        return Value::Null;
    }
    let parsed = match serde_json::from_str(cell) {
        Ok(value) if !present.is_string() => Some(value),
        _ => None,
    };
    let number = || cell.parse::<f64>().ok().filter(|x| x.is_finite() && !present.is_string());
    parsed.or_else(|| number().map(Value::from)).unwrap_or_else(|| cell.into())
}
