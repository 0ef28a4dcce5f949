//! Sinew benches.
