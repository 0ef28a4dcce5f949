//! Sinew demos.
