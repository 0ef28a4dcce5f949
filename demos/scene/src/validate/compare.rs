//! Differences of fields.

use glam::DVec3;

/// The larger of two differences; a NaN counts as the largest and is not lost.
pub(super) fn worst(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

pub(super) fn largest(a: &[DVec3]) -> f64 {
    a.iter().map(|a| a.length()).fold(0.0, f64::max)
}

/// Largest and root-mean-square distance over `scale`.
pub(super) fn difference(a: &[DVec3], b: &[DVec3], scale: f64) -> (f64, f64) {
    let scale = if scale > 0.0 { scale } else { 1.0 };
    let mut max = 0.0_f64;
    let mut sum = 0.0;
    for (a, b) in a.iter().zip(b) {
        let d = a.distance(*b) / scale;
        max = worst(max, d);
        sum += d * d;
    }
    (max, (sum / a.len().max(1) as f64).sqrt())
}

/// What is nearest to `truth` among the mixtures of some fields.
pub(super) fn nearest(fields: impl Iterator<Item = Vec<DVec3>>, truth: &[DVec3]) -> Vec<DVec3> {
    let product =
        |a: &[DVec3], b: &[DVec3]| -> f64 { a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum() };
    let mut orthogonal: Vec<Vec<DVec3>> = Vec::new();
    let mut sum = vec![DVec3::ZERO; truth.len()];
    for mut field in fields {
        for known in &orthogonal {
            let factor = product(&field, known) / product(known, known);
            field.iter_mut().zip(known).for_each(|(f, k)| *f -= factor * *k);
        }
        let factor = product(&field, truth) / product(&field, &field);
        sum.iter_mut().zip(&field).for_each(|(s, f)| *s += factor * *f);
        orthogonal.push(field);
    }
    sum
}
