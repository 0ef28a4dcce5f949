//! Settings, springs and material constants that fit, and sweeps over parameters: what stands behind `sinew advise`,
//! `sinew fit` and `sinew sweep`.
//!
//! * [`advise`](mod@advise): settings that run a scene within a budget of time and error on this machine.
//! * [`fit`]: springs for a mesh, and what they are worth in virtual tests.
//! * [`fit_data`]: material constants of a static scene from measured displacements and forces.
//! * [`plot`]: charts of what runs recorded over time.
//! * [`sweep`]: many runs of one scene, planned, run in shards and merged.
//! * [`machine`], [`measures`], [`table`], [`page`]: where and how runs are compared, also for the laboratory.

pub mod advise;
mod chart;
pub mod fit;
pub mod fit_data;
pub mod machine;
pub mod measures;
pub mod page;
pub mod plot;
pub mod sweep;
pub mod table;
