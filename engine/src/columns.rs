//! Table columns as slices. A query over components that live in one table hands out whole
//! columns; kernels see nothing else.

use bevy_ecs::query::QueryNotDenseError;

/// The slices of the one table that a contiguous query matches, or `None` when there is no row.
///
/// ```
/// # use bevy_ecs::prelude::*;
/// # use sinew_engine::columns::single_table;
/// #[derive(Component)]
/// struct Charge(f64);
/// let mut world = World::new();
/// world.spawn_batch((0..4).map(|i| Charge(i as f64)));
/// let mut query = world.query::<&Charge>();
/// let column = single_table(query.contiguous_iter(&world)).unwrap();
/// assert_eq!(column.iter().map(|c| c.0).sum::<f64>(), 6.0);
/// ```
///
/// # Panics
/// When the matching rows are spread over several tables: somebody added or removed a component of
/// an element after its body was spawned. [`crate::step::run_step`] refuses such a world with a
/// typed error before any system gets here.
#[inline]
pub fn single_table<I: Iterator>(tables: Result<I, QueryNotDenseError>) -> Option<I::Item> {
    let mut tables = tables.expect("element components are stored in tables");
    let first = tables.next();
    assert!(tables.next().is_none(), "element rows are spread over several tables");
    first
}
