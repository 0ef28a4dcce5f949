//! The engine of Sinew: meshes, the layout of bodies as entities, schedules, the sum of forces, and the block matrix.
//! It knows no material and no integrator.
//!
//! Vertices and elements are entities; in pooled bodies edges and triangles are too. Kernels see whole table
//! columns as slices. `ARCHITECTURE.md` at the root of the repository says how the parts work together.

pub mod columns;
pub mod compression;
pub mod connectivity;
pub mod element;
pub mod element_kind;
pub mod fnv;
pub mod isoparametric;
pub mod kept;
pub mod lanes;
pub mod law;
pub mod layout;
pub mod load;
pub mod matrix;
pub mod memory;
pub mod mesh;
pub mod order;
pub mod precision;
pub mod ratios;
pub mod read;
pub mod report;
pub mod resource;
pub mod row;
pub mod scalar;
pub mod schedule;
pub mod sets;
pub mod simd;
pub mod step;
pub mod stopwatch;
pub mod substep;
pub mod surface;
pub mod time;
pub mod topology;
pub mod vertex;
pub mod workers;
