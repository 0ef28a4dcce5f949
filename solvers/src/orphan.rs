//! Vertices without elements, which removing elements may leave. Nothing acts on them but outside
//! forces, so their step is known beforehand and no linear solve, line search or energy cap of their
//! former body may touch it: they take part in implicit steps as held unknowns that move along it.

use crate::settings::SolverSettings;
use crate::state::NodeState;
use sinew_engine::layout::UNUSED;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::FixedAxes;

/// A vertex row without elements, and its step.
pub(crate) struct Orphan<S> {
    pub row: usize,
    /// Axes held by constraints.
    pub held: FixedAxes,
    /// Velocity (m/s) of the others at the end of the step.
    pub velocity: [S; 4],
}

/// Prescribes the step of length `h` (s) of the vertices without elements on their free axes, with mass
/// damping: implicit Euler's for integrators of first order, else the midpoint rule's, which is exact without
/// damping. Those without mass stay where they are, as all do in equilibria.
pub(crate) fn prescribe_orphans<S: Scalar>(
    topology: &Topology,
    node: &mut NodeState<S>,
    h: f64,
    settings: &SolverSettings,
) -> Vec<Orphan<S>> {
    let (damping, facts) = (settings.mass_damping, settings.integrator.facts());
    let euler = facts.order == 1;
    let mut orphans = Vec::new();
    for body in &topology.bodies {
        for (local, _) in body.piece.iter().enumerate().filter(|(_, piece)| **piece == UNUSED) {
            let row = body.vertices.start as usize + local;
            let mass = node.mass[row].to_f64();
            let moves = mass > 0.0 && facts.dynamic;
            let mut velocity = [S::ZERO; 4];
            for k in (0..3).filter(|&k| !node.fixed[row].holds(k)) {
                let mut u = node.u[row][k];
                if moves {
                    let acceleration = node.external[row][k].to_f64() / mass;
                    let v = node.v[row][k].to_f64();
                    let (new, mean) = if euler {
                        let new = (v + h * acceleration) / (1.0 + h * damping);
                        (new, new)
                    } else {
                        let half = 0.5 * h * damping;
                        let new = (v * (1.0 - half) + h * acceleration) / (1.0 + half);
                        (new, 0.5 * (v + new))
                    };
                    u += S::from_f64(h * mean);
                    velocity[k] = S::from_f64(new);
                }
                node.prescribed[row][k] = u;
            }
            let held = std::mem::replace(&mut node.fixed[row], FixedAxes::ALL);
            orphans.push(Orphan { row, held, velocity });
        }
    }
    orphans
}
