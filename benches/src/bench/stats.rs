//! Repeated timings: variants take turns, so that what else the machine does meets all alike, and
//! every figure keeps its spread.

use serde::{Deserialize, Serialize};
use sinew_tune::measures::quantile;

/// Order statistics of repeated measurements; unit of the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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

    /// Distance between the quartiles over the median.
    pub fn relative_spread(&self) -> f64 {
        (self.upper_quartile - self.lower_quartile) / self.median
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_neighbours() {
        let spread = Spread::of(&[4.0, 1.0, 3.0, 2.0]).unwrap();
        assert_eq!(
            spread,
            Spread {
                samples: 4,
                minimum: 1.0,
                lower_quartile: 1.75,
                median: 2.5,
                upper_quartile: 3.25
            }
        );
        assert_eq!(spread.scaled(2.0).median, 5.0);
        assert_eq!(spread.relative_spread(), 0.6);
        let one = Spread::of(&[7.0]).unwrap();
        assert_eq!([one.minimum, one.lower_quartile, one.median, one.upper_quartile], [7.0; 4]);
        assert_eq!((Spread::of(&[]), Spread::of(&[1.0, f64::NAN])), (None, None));
    }

    #[test]
    fn variants_take_turns_and_slow_ones_drop_out() {
        let mut order = Vec::new();
        let rounds = Rounds { most: 4, least: 2, seconds: 1.5 };
        let samples = interleave(&mut [0.1, 1.0], rounds, |seconds| {
            order.push(*seconds);
            Ok::<f64, ()>(*seconds)
        })
        .unwrap();
        assert_eq!(order, [0.1, 1.0, 0.1, 1.0, 0.1, 0.1]);
        assert_eq!((samples[0].len(), samples[1].len()), (4, 2));
        assert_eq!(interleave(&mut [1], rounds, |_| Err::<f64, _>("no")), Err("no"));
    }
}
