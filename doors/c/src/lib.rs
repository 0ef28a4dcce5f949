//! Sinew as a library for C: the header is `doors/c/include/sinew.h`, which a test writes from these sources.
//!
//! A thin skin over `sinew-embed`: pointers become slices and texts, results become codes, panics become code 99. `unsafe`
//! is what touches pointers of the caller and nothing else, and the promise is the same everywhere: pointers are NULL or point
//! to what they say; what is freed came from this library, was not freed and is not used any more. `call` tells, place by
//! place, what follows from it.
#![allow(non_camel_case_types, reason = "names of C")]
#![allow(
    unsafe_op_in_unsafe_fn,
    clippy::missing_safety_doc,
    reason = "one promise for all functions, told above"
)]

mod act;
mod body;
mod call;
mod live;
mod mesh;
mod report;
mod reports;
mod simulation;
mod snapshot;
mod thread;
mod touch;
mod types;

pub use act::*;
pub use body::*;
pub use call::*;
pub use live::*;
pub use mesh::*;
pub use report::*;
pub use reports::*;
pub use simulation::*;
pub use snapshot::*;
pub use thread::*;
pub use touch::*;
pub use types::*;
