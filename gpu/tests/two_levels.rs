//! The two-level preconditioner on the device.
mod common;

use common::{MATERIAL, beam, device, relative, say};
use sinew::prelude::*;
use sinew::solvers::settings::Preconditioner;
use sinew_gpu::GpuOptions;

fn settings(preconditioner: Preconditioner) -> SolverSettings {
    SolverSettings { integrator: Integrator::Safe, preconditioner, ..SolverSettings::default() }
}

/// Iterations a step of a beam that falls, its name of the preconditioner, and how often that was computed.
#[test]
fn iterations() {
    let mesh = beam([24, 6, 6]);
    for backend in [Backend::Cpu, Backend::Gpu] {
        for p in [Preconditioner::Multigrid, Preconditioner::BlockJacobi] {
            let mut s = if backend == Backend::Cpu { Simulation::new(SimulationOptions::default()).unwrap() } else {
                Simulation::with_gpu(SimulationOptions::default(), device(&GpuOptions::default()).unwrap()).unwrap() };
            let body = s.add_body(&BodyDescription::new("beam", &mesh, MATERIAL)).unwrap();
            s.set_solver(settings(p));
            let rows = s.group_rows(body, &mesh, "x0").unwrap();
            s.add_constraint(Constraint::hold("x0", rows));
            let clock = std::time::Instant::now();
            for _ in 0..10 { s.step().unwrap();
            let r = s.report();
            say(&format!("{backend:?} {} its {} refresh {} break {} res {:.1e}", r.preconditioner, r.cg_iterations, r.preconditioner_refreshes, r.preconditioner_breakdowns, r.cg_residual)); }
            say(&format!("{:?}", clock.elapsed()));
        }
    }
}
