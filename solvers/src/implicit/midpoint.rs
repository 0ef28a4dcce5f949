//! Implicit midpoint rule: implicit Euler to the middle of the step, then twice the increment.

use super::step::{ImplicitScratch, Step, StepMode};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::StepError;

impl<S: Scalar> Step<'_, S> {
    /// The midpoint rule to convergence.
    pub fn midpoint(&mut self) -> Result<(), StepError> {
        let ImplicitScratch { within, node, .. } = &mut *self.scratch;
        within.read(self.world, &node.u, &node.prescribed, &node.fixed);
        self.scratch.use_middle_of_step();
        for body in &mut self.bodies {
            (body.mode, body.past.history_holds) = (StepMode::Converge, false);
        }
        self.tools_at(0.5);
        self.start_at_predictor(0.5 * self.dt);
        self.minimise()?;
        self.tools_at(1.0);
        self.extrapolate_from_middle();
        Ok(())
    }

    /// From the middle of the step to its end.
    fn extrapolate_from_middle(&mut self) {
        let scratch = &mut *self.scratch;
        let half = S::from_f64(0.5 * self.dt);
        for row in self.bodies.iter().flat_map(|body| body.rows.clone()) {
            for k in 0..3 {
                let middle = scratch.increment[row][k];
                let free = scratch.node.free(row, k);
                scratch.set_increment(row, k, middle + middle);
                // the velocity at the end is (d - o) / (h / 2)
                scratch.offset[row][k] = if free { half * scratch.node.v[row][k] } else { middle };
                if !free {
                    scratch.iterate[row][k] = scratch.node.prescribed[row][k];
                }
            }
        }
        let energies = self.energies_at_iterate();
        for (body, energy) in self.bodies.iter_mut().zip(energies) {
            body.elastic = energy;
        }
    }
}

impl<S: Scalar> ImplicitScratch<S> {
    /// Loads in the middle of the step; held unknowns go half of their way.
    fn use_middle_of_step(&mut self) {
        self.use_loads_at(0.5);
        let half = S::from_f64(0.5);
        for row in 0..self.node.len() {
            for k in self.node.held_axes(row) {
                let u = self.node.u[row][k];
                self.prescribed[row][k] = u + half * (self.node.prescribed[row][k] - u);
            }
        }
    }
}
