//! Errors of one set of positions against another (paper B, section 5).

use serde::{Deserialize, Serialize};

use crate::error::IdentifyError;
use crate::geometry::{norm, sub};

/// Errors in percent of the largest displacement of the reference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PositionErrors {
    /// `100 sqrt(mean e_i^2) / o_max`, with the distances `e_i` between the two positions of node `i`.
    pub rms_percent: f64,
    /// `100 max e_i / o_max`.
    pub max_percent: f64,
    /// Largest displacement `o_max` of the reference, m.
    pub largest_displacement: f64,
}

/// Compares positions `found` with `reference`, both deformed from `rest` (m).
///
/// # Errors
/// [`IdentifyError::Positions`] if the sets are empty, differ in length, or the reference does not move.
///
/// ```
/// use sinew_identify::error_metrics::position_errors;
///
/// let rest = [[0.0; 3], [1.0, 0.0, 0.0]];
/// let reference = [[0.0; 3], [3.0, 0.0, 0.0]];
/// let found = [[0.0; 3], [3.0, 0.2, 0.0]];
/// let errors = position_errors(&rest, &reference, &found)?;
/// assert!((errors.max_percent - 10.0).abs() < 1e-12);
/// assert!((errors.rms_percent - 10.0 / 2f64.sqrt()).abs() < 1e-12);
/// # Ok::<(), sinew_identify::IdentifyError>(())
/// ```
pub fn position_errors(
    rest: &[[f64; 3]],
    reference: &[[f64; 3]],
    found: &[[f64; 3]],
) -> Result<PositionErrors, IdentifyError> {
    if rest.is_empty() || rest.len() != reference.len() || rest.len() != found.len() {
        return Err(IdentifyError::Positions(
            "give three lists of the same length, with at least one node",
        ));
    }
    let largest = rest.iter().zip(reference).map(|(x, y)| norm(sub(*x, *y))).fold(0.0, f64::max);
    if largest.is_nan() || largest <= 0.0 {
        return Err(IdentifyError::Positions(
            "the reference does not move, so errors relative to its largest displacement have no meaning",
        ));
    }
    let distances = reference.iter().zip(found).map(|(x, y)| norm(sub(*x, *y)));
    let (squares, max) = distances.fold((0.0, 0f64), |(s, m), e| (s + e * e, m.max(e)));
    Ok(PositionErrors {
        rms_percent: 100.0 * (squares / rest.len() as f64).sqrt() / largest,
        max_percent: 100.0 * max / largest,
        largest_displacement: largest,
    })
}
