//! Queries that are made once: to make one costs more than to look through a short table.

use crate::resource::ensure;
use bevy_ecs::prelude::*;
use bevy_ecs::query::{QueryData, QueryFilter};
use std::any::{Any, TypeId};
use std::collections::BTreeMap;

/// The queries of a world that [`with_query`] made, by their types.
#[derive(Resource, Default)]
struct KeptQueries(BTreeMap<TypeId, Box<dyn Any + Send + Sync>>);

/// Calls `f` with a query of the world, which is kept for the next call.
///
/// ```
/// use bevy_ecs::prelude::*;
/// use sinew_engine::kept::with_query;
///
/// #[derive(Component)]
/// struct Charge(f64);
///
/// let mut world = World::new();
/// for sum in [1.0, 2.0] {
///     world.spawn(Charge(1.0));
///     let found: f64 = with_query::<&Charge, (), _>(&mut world, |world, query| query.iter(world).map(|own| own.0).sum());
///     assert_eq!(found, sum);
/// }
/// ```
pub fn with_query<D: QueryData + 'static, F: QueryFilter + 'static, R>(
    world: &mut World,
    f: impl FnOnce(&mut World, &mut QueryState<D, F>) -> R,
) -> R {
    let id = TypeId::of::<QueryState<D, F>>();
    let known = ensure::<KeptQueries>(world).0.remove(&id);
    let known = known.and_then(|own| own.downcast::<QueryState<D, F>>().ok());
    let mut query = known.unwrap_or_else(|| Box::new(world.query_filtered::<D, F>()));
    let result = f(world, &mut query);
    ensure::<KeptQueries>(world).0.insert(id, query);
    result
}
