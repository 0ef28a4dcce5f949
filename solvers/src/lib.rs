//! Sinew solvers.
