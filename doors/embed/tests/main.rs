//! Tests of the plain face: hashes, handles, errors, buffers, and every door once.

mod bodies;
mod doors;
mod errors;
mod film;
mod lists;
mod live;
mod scenes;
mod snapshots;

use sinew_embed::*;

/// A slab of 0.1 m x 0.1 m x 0.05 m, four by four by two cells of tetrahedra.
pub fn slab() -> Mesh {
    mesh_from_generator("box = { size = [0.1, 0.1, 0.05], cells = [4, 4, 2] }").unwrap()
}

/// One thread, without gravity.
pub fn options() -> Options {
    Options { threads: 1, gravity: [0.0; 3], ..Options::default() }
}

/// The same for equilibria, solved to the end.
pub fn equilibria() -> Options {
    let solver = SolverSettings {
        integrator: Integrator::QuasiStatic,
        linear_tolerance: 1e-10,
        ..SolverSettings::default()
    };
    Options { solver, ..options() }
}

/// A slab that is held below.
pub fn held(options: &Options) -> (Embedding, Handle, Handle) {
    let mesh = slab();
    let mut sim = Embedding::new(options).unwrap();
    let description = BodyDescription::new("slab", &mesh, preset("liver").unwrap());
    let body = sim.add_body(&mesh, &description).unwrap();
    let floor = sim.group(body, "z0").unwrap();
    let hold = sim.add_constraint(body, &ConstraintSpec::hold("floor", &floor)).unwrap();
    (sim, body, hold)
}
