//! What a bench is asked for.

/// What is measured.
#[derive(Clone, Debug)]
pub struct BenchOptions {
    /// Smaller sizes, fewer repeats.
    pub quick: bool,
    /// Sizes of bodies (tetrahedra, about), where a part has a choice; chosen by `quick` when empty.
    pub sizes: Vec<usize>,
    /// Cases of the accuracy part, kinds of contact, `beam` or `touch` of the rivals; all when empty.
    pub cases: Vec<String>,
    /// Python with the package `mujoco`, for the rivals.
    pub python: String,
}
