//! Implicit Euler: the safe step, linearised once and capped, and the step solved to convergence.

use super::step::{Step, StepMode, Weights};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::StepError;

impl<S: Scalar> Step<'_, S> {
    /// One Newton step with line search and energy cap.
    pub fn safe_euler(&mut self) -> Result<(), StepError> {
        self.euler(StepMode::Safe)
    }

    /// Newton to convergence.
    pub fn converged_euler(&mut self) -> Result<(), StepError> {
        self.euler(StepMode::Converge)
    }

    fn euler(&mut self, mode: StepMode) -> Result<(), StepError> {
        for body in &mut self.bodies {
            (body.mode, body.weights) = (mode, Weights::new(self.settings, self.dt));
        }
        let before = if self.scratch.begin() { Some(self.energies_at_start()) } else { None };
        self.freeze_damping(|s| &s.node.u);
        for body in &self.bodies {
            self.scratch.set_euler_inertia(body, self.dt);
        }
        self.minimise_and_open_books(before)
    }
}
