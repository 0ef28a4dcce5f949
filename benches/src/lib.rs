//! Sinew benches: the hard-case suite; criterion benches live in `benches/`.

pub mod stability;
