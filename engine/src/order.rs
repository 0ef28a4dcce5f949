//! The order in which constraints, loads, tools and the like came into a world.
//!
//! Where several act on one vertex, sums and overlaps follow this order, so that results do not depend on how the world
//! numbers its entities. It is also the name by which a snapshot knows them: a simulation that is built anew by the
//! same program gives them the same numbers.

use bevy_ecs::lifecycle::HookContext;
use bevy_ecs::prelude::*;
use bevy_ecs::world::DeferredWorld;
use serde::{Deserialize, Serialize};

/// Place of an entity that acts on bodies, counted from 1 in its world; 0 until it is in one.
///
/// ```
/// use bevy_ecs::prelude::*;
/// use sinew_engine::load::Constraint;
/// use sinew_engine::order::{LastOrder, Order};
/// use sinew_engine::row::VertexRow;
///
/// let mut world = World::new();
/// world.init_resource::<LastOrder>();
/// let first = world.spawn(Constraint::hold("wall", vec![VertexRow(0)])).id();
/// let second = world.spawn(Constraint::hold("tool", vec![VertexRow(1)])).id();
/// assert_eq!(world.get::<Order>(first), Some(&Order(1)));
/// assert_eq!(world.get::<Order>(second), Some(&Order(2)));
/// ```
#[derive(
    Component,
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
)]
#[component(on_add = number)]
pub struct Order(pub u64);

/// The number that was given last.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LastOrder(pub u64);

fn number(mut world: DeferredWorld, HookContext { entity, .. }: HookContext) {
    let given = world.get::<Order>(entity).map_or(0, |order| order.0);
    let Some(mut last) = world.get_resource_mut::<LastOrder>() else { return };
    // one that comes back from a snapshot keeps its number
    last.0 = if given == 0 { last.0 + 1 } else { last.0.max(given) };
    let next = last.0;
    if given == 0
        && let Some(mut order) = world.get_mut::<Order>(entity)
    {
        order.0 = next;
    }
}
