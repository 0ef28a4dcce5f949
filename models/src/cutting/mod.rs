//! Cuts: a blade goes through bodies of linear tetrahedra.

pub mod material;
