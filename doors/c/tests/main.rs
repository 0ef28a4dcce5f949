//! The functions of the header, called as C would call them.
#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "tests that hand over wrong pointers on purpose"
)]

#[path = "../src/lib.rs"]
#[allow(dead_code, reason = "constants that only C uses")]
mod api;

mod header;
mod live;
mod misuse;
mod use_;

use api::*;
use std::ffi::{CStr, CString};
use std::ptr::{null, null_mut};

/// A structure of the header with nothing in it but its size.
macro_rules! sized {
    ($type:ty { $($field:ident: $value:expr),* $(,)? }) => {{
        let mut own: $type = crate::blank();
        own.struct_size = size_of::<$type>() as u32;
        $(own.$field = $value;)*
        own
    }};
}
pub(crate) use sized;

/// A structure of the header of zeros.
pub(crate) fn blank<T: Copy>() -> T {
    unsafe { std::mem::zeroed() }
}

/// What the last call said.
pub(crate) fn said() -> String {
    unsafe { CStr::from_ptr(sinew_last_error()) }.to_str().unwrap().to_string()
}

/// Demands success.
#[track_caller]
pub(crate) fn ok(status: sinew_status) {
    assert_eq!(status, SINEW_OK, "{}", said());
}

pub(crate) fn c(text: &str) -> CString {
    CString::new(text).unwrap()
}

/// A slab of tetrahedra, held below, under gravity.
pub(crate) struct Slab {
    pub(crate) sim: *mut sinew_simulation,
    pub(crate) mesh: *mut sinew_mesh,
    pub(crate) body: sinew_handle,
    pub(crate) hold: sinew_handle,
    pub(crate) vertices: usize,
}

impl Slab {
    pub(crate) fn new(threads: u32) -> Self {
        let made = sinew_embed::mesh_from_generator(
            "box = { size = [0.1, 0.1, 0.05], cells = [4, 4, 2] }",
        );
        let made = made.unwrap();
        let points: Vec<f64> = made.points.iter().flat_map(|x| x.to_array()).collect();
        let floor = &made.group("z0").unwrap().vertices;
        let name = c("floor");
        let group = sinew_group {
            name: name.as_ptr(),
            vertices: floor.as_ptr(),
            vertex_count: floor.len(),
        };
        let arrays = sized!(sinew_mesh_arrays {
            points: points.as_ptr(),
            point_count: made.points.len(),
            tetrahedra: made.tetrahedra.as_ptr().cast(),
            tetrahedron_count: made.tetrahedra.len(),
            groups: &group,
            group_count: 1,
        });
        let (mut sim, mut mesh) = (null_mut(), null_mut());
        let (mut body, mut hold) = (0, 0);
        let options =
            sized!(sinew_options { dt: 0.01, threads: threads, gravity: [0.0, 0.0, -9.81] });
        let (slab, liver) = (c("slab"), c("liver"));
        let material = sized!(sinew_material { preset: liver.as_ptr() });
        let described = sized!(sinew_body { name: slab.as_ptr(), material: &material });
        unsafe {
            ok(sinew_mesh_from_arrays(&arrays, &mut mesh));
            ok(sinew_simulation_new(&options, &mut sim));
            ok(sinew_body_add(sim, mesh, &described, &mut body));
            let mut needed = 0;
            ok(sinew_group_vertices(sim, body, name.as_ptr(), null_mut(), 0, &mut needed));
            let mut list = vec![0; needed];
            ok(sinew_group_vertices(
                sim,
                body,
                name.as_ptr(),
                list.as_mut_ptr(),
                needed,
                &mut needed,
            ));
            assert_eq!(&list, floor);
            ok(sinew_hold(sim, body, name.as_ptr(), list.as_ptr(), needed, &mut hold));
        }
        Self { sim, mesh, body, hold, vertices: made.points.len() }
    }

    pub(crate) fn hash(&self) -> u64 {
        let mut hash = 0;
        ok(unsafe { sinew_hash(self.sim, &mut hash) });
        hash
    }

    pub(crate) fn read(&self, quantity: u32) -> Vec<f64> {
        let mut needed = 0;
        unsafe {
            ok(sinew_read(self.sim, self.body, quantity, null_mut(), 0, &mut needed));
            let mut values = vec![f64::NAN; needed];
            ok(sinew_read(self.sim, self.body, quantity, values.as_mut_ptr(), needed, null_mut()));
            values
        }
    }
}

impl Drop for Slab {
    fn drop(&mut self) {
        unsafe {
            sinew_simulation_free(self.sim);
            sinew_mesh_free(self.mesh);
        }
    }
}

/// A pointer that points nowhere, of whatever type is asked for.
pub(crate) fn nil<T>() -> *const T {
    null()
}
