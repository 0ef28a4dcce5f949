//! Sinew as a library for C: the header is `doors/c/include/sinew.h`, which a test writes from these sources.
//!
//! A thin skin over `sinew-embed`: pointers become slices and texts, results become codes, panics become code 99. `unsafe`
//! is what touches pointers of the caller and nothing else.
#![allow(non_camel_case_types, reason = "names of C")]

mod act;
mod body;
mod call;
mod mesh;
mod report;
mod simulation;
mod snapshot;
mod touch;
mod types;

pub use act::*;
pub use body::*;
pub use call::*;
pub use mesh::*;
pub use report::*;
pub use simulation::*;
pub use snapshot::*;
pub use touch::*;
pub use types::*;
