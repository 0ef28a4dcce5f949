//! Mesh files and the mesh check. In one binary: each would link, and in part compile, everything below for itself.

mod common;
mod malformed;
mod mesh_check;
mod mesh_check_mixed;
mod mesh_io;
mod mesh_mixed_io;
mod mesh_select;
