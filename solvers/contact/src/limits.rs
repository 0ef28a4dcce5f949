//! How an evaluation of contact treats the limits of friction.

/// Treatment of the limits of friction (Pa) in an evaluation. The energy is a potential while they are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limits {
    /// The limits stay those of the last evaluation that changed them.
    Keep,
    /// The limits follow from the pressures of this evaluation.
    Take,
    /// The limits are those of the end of the last step. For the first iterate of a step, where inertia alone moves
    /// bodies and pressures mean little.
    Recall,
    /// As `Take`, but 0 for points that were not pressed at the last evaluation: the pressure of a point that has only
    /// just come in is far too high.
    Follow,
    /// The limits go half of the way to those of `Take`, which ends an alternation of sticking and slipping.
    Approach,
}
