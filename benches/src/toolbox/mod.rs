//! What every part of the laboratory is made of: bodies and meshes, repeated timings, charts, files and errors. Tables,
//! pages and notes on the machine are those of `sinew_tune`.

pub mod aim;
pub mod beam;
pub mod error;
pub mod meshes;
pub mod options;
pub mod plot;
pub mod prelude;
pub mod report;
pub mod stats;
