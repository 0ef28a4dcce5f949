//! Settings, springs and material constants that fit: what stands behind `sinew advise` and `sinew fit`.
//!
//! * [`advise`](mod@advise): settings that run a scene within a budget of time and error on this machine.
//! * [`fit`]: springs for a mesh, and what they are worth in virtual tests.
//! * [`fit_data`]: material constants of a static scene from measured displacements and forces.
//! * [`machine`], [`measures`], [`table`]: where and how runs are compared, also for the laboratory.

pub mod advise;
pub mod fit;
pub mod fit_data;
pub mod machine;
pub mod measures;
pub mod table;
