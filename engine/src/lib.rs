//! Sinew engine: mesh data, ECS layout, schedule, gather and block matrix.
//!
//! Vertices, edges, triangles and tetrahedra are entities; kernels see whole table columns as
//! slices. See `ARCHITECTURE.md` at the root of the repository for the map.

pub mod columns;
pub mod connectivity;
pub mod element;
pub mod element_kind;
pub mod isoparametric;
pub mod lanes;
pub mod law;
pub mod layout;
pub mod load;
pub mod matrix;
pub mod mesh;
pub mod report;
pub mod scalar;
pub mod schedule;
pub mod step;
pub mod substep;
pub mod time;
pub mod topology;
pub mod vertex;
pub mod workers;
