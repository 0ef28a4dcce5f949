//! Sinew benches: the hard-case suite and the rivals; criterion benches live in `benches/`.

pub mod peers;
pub mod stability;
