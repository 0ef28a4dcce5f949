//! BDF2 solved to convergence; implicit Euler where there is no history.

use super::step::{Step, StepMode};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::StepError;

impl<S: Scalar> Step<'_, S> {
    /// BDF2 to convergence, from where the velocities lead.
    pub fn bdf2(&mut self) -> Result<(), StepError> {
        for body in &mut self.bodies {
            body.mode = StepMode::Converge;
            self.report.fallbacks.start += u32::from(!body.past.history_holds);
        }
        self.start_at_predictor(self.dt);
        self.minimise()
    }
}
