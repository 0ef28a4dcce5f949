//! Distance fields of closed meshes.
