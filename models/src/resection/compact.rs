//! Compaction of tables and edge graph.
use super::Resection;
use bevy_ecs::prelude::World;
use sinew_engine::scalar::Scalar;

pub(super) fn compact<S: Scalar>(_world: &mut World, _resection: &mut Resection) -> bool {
    false
}
