//! Tools that touch bodies, contact between bodies, friction and pulls.

pub mod field;
