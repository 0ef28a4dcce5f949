//! Repeated timings: variants take turns, so that what else the machine does meets all alike, and
//! every figure keeps its spread.

use serde::Serialize;
use sinew_tune::measures::quantile;
use sinew_tune::table::three_digits;

/// Order statistics of repeated measurements; unit of the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Number of samples.
    pub samples: usize,
    /// Smallest.
    pub minimum: f64,
    /// A quarter of the samples is smaller.
    pub lower_quartile: f64,
    /// Half of the samples are smaller.
    pub median: f64,
    /// Three quarters of the samples are smaller.
    pub upper_quartile: f64,
}

impl Spread {
    /// Of at least one sample; `None` without any or when one is not a number.
    pub fn of(samples: &[f64]) -> Option<Self> {
        let mut sorted = samples.to_vec();
        sorted.sort_by(f64::total_cmp);
        let (&minimum, &last) = (sorted.first()?, sorted.last()?);
        if minimum.is_nan() || last.is_nan() {
            return None;
        }
        Some(Self {
            samples: sorted.len(),
            minimum,
            lower_quartile: quantile(&sorted, 0.25),
            median: quantile(&sorted, 0.5),
            upper_quartile: quantile(&sorted, 0.75),
        })
    }

    /// Without the first sample, which warms up pages and caches, unless it is the only one.
    pub fn warm(samples: &[f64]) -> Option<Self> {
        let all = Self::of(samples)?;
        Some(Self::of(&samples[1..]).unwrap_or(all))
    }

    /// The same in another unit.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            samples: self.samples,
            minimum: self.minimum * factor,
            lower_quartile: self.lower_quartile * factor,
            median: self.median * factor,
            upper_quartile: self.upper_quartile * factor,
        }
    }

    /// `lower-upper` quartile, for tables.
    pub fn quartiles(&self) -> String {
        format!("{}-{}", three_digits(self.lower_quartile), three_digits(self.upper_quartile))
    }
}

/// Median of samples; `None` without any or when one is not a number.
pub fn median(samples: &[f64]) -> Option<f64> {
    Some(Spread::of(samples)?.median)
}

/// How often variants take turns.
#[derive(Clone, Copy, Debug)]
pub struct Rounds {
    /// Turns every variant gets, if its share of the time lasts.
    pub most: usize,
    /// Turns it gets in any case.
    pub least: usize,
    /// Time (s) after which a variant drops out.
    pub seconds: f64,
}

/// Measures variants turn by turn. `measure` returns the seconds that count; the samples come back
/// variant by variant.
///
/// # Errors
/// The first error of `measure`.
pub fn interleave<V, E>(
    variants: &mut [V],
    rounds: Rounds,
    mut measure: impl FnMut(&mut V) -> Result<f64, E>,
) -> Result<Vec<Vec<f64>>, E> {
    let mut samples = vec![Vec::new(); variants.len()];
    let mut spent = vec![0.0; variants.len()];
    for round in 0..rounds.most.max(1) {
        for (i, variant) in variants.iter_mut().enumerate() {
            if round >= rounds.least.max(1) && spent[i] > rounds.seconds {
                continue;
            }
            let seconds = measure(variant)?;
            spent[i] += seconds;
            samples[i].push(seconds);
        }
    }
    Ok(samples)
}
