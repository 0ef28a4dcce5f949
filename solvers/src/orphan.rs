//! Vertices without elements, which removing elements may leave. Nothing acts on them but outside
//! forces, so their step is known beforehand and no linear solve, line search or energy cap of their
//! former body may touch it: they take part in implicit steps as held unknowns that move along it.

use crate::state::NodeState;
use sinew_engine::layout::UNUSED;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::FixedAxes;

/// Prescribes the step of the vertices without elements on their free axes: the `d` (m) that solves
/// `m inertia (d - h v) + m damping d = f`. Those without mass, or without inertia, stay where they
/// are. Returns whether there are any.
pub(crate) fn prescribe_orphans<S: Scalar>(
    topology: &Topology,
    node: &mut NodeState<S>,
    h: f64,
    inertia: f64,
    damping: f64,
) -> bool {
    let mut any = false;
    for body in &topology.bodies {
        for (local, _) in body.piece.iter().enumerate().filter(|(_, piece)| **piece == UNUSED) {
            any = true;
            let row = body.vertices.start as usize + local;
            let mass = node.mass[row].to_f64();
            let flies = mass > 0.0 && inertia > 0.0;
            for k in (0..3).filter(|&k| !node.fixed[row].holds(k)) {
                let mut u = node.u[row][k];
                if flies {
                    let force = node.external[row][k].to_f64() / mass;
                    let drift = h * node.v[row][k].to_f64();
                    u += S::from_f64((inertia * drift + force) / (inertia + damping));
                }
                node.prescribed[row][k] = u;
            }
            node.fixed[row] = FixedAxes::ALL;
        }
    }
    any
}
