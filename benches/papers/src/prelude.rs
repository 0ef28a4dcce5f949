//! What nearly every figure speaks of.

pub(crate) use crate::figure::{Figure, Finding};
pub(crate) use sinew_benches::toolbox::plot::{Scales, Series, lines};
pub(crate) use sinew_benches::toolbox::prelude::*;
