//! What nearly every file of the laboratory speaks of.

pub use super::error::{BenchError, Result};
pub use serde::Serialize;
pub use sinew::prelude::*;
pub use sinew_tune::page::Chart;
pub use sinew_tune::table::{Cell, Table};
pub use sinew_tune::table_of;
pub use std::time::Instant;
