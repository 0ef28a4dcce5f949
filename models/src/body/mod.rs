//! From mesh and material to entities: every stiffness is precomputed here, in `f64`.

pub mod axis_modulus;
pub mod change;
pub mod clusters;
pub mod description;
pub mod edit_log;
pub mod lumped;
pub(crate) mod matter;
pub mod present;
pub mod sheet;
pub(crate) mod spawn;
mod surface;

pub use self::description::{BodyDescription, BodyError, MassRule, SoftBody};
pub use self::spawn::spawn_body;
pub use crate::frame::rules::{Evaluation, Integration, VolumeRule};
pub use crate::laws::models::Model;
