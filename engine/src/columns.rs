//! Table columns as slices. A query over components that live in one table hands out whole
//! columns; kernels see nothing else.

use bevy_ecs::prelude::{Entity, World};
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

/// Whether [`move_rows_to_front`] can move the rows of the table that holds an entity: no component of it
/// owns anything.
pub fn can_move_rows(world: &World, entity: Entity) -> bool {
    let info = |id| world.components().get_info(id);
    let own = world.entity(entity);
    own.archetype()
        .components()
        .iter()
        .all(|&id| info(id).is_some_and(|info| info.drop().is_none()))
}

/// Copies rows of the table that holds an entity, given in ascending order, to its front, all columns alike:
/// whatever laws or users put there. Entities stay where they are, and ticks of changes too.
///
/// ```
/// # use bevy_ecs::prelude::*;
/// # use sinew_engine::columns::move_rows_to_front;
/// #[derive(Component)]
/// struct Charge(f64);
/// let mut world = World::new();
/// let first = world.spawn(Charge(0.0)).id();
/// world.spawn_batch((1..5).map(|i| Charge(i as f64)));
/// move_rows_to_front(&mut world, first, &[1, 4]);
/// assert_eq!(world.query::<&Charge>().iter(&world).map(|c| c.0).collect::<Vec<_>>(), [1.0, 4.0, 2.0, 3.0, 4.0]);
/// ```
///
/// # Panics
/// When [`can_move_rows`] says no, or a row lies outside the table or not above the one before.
pub fn move_rows_to_front(world: &mut World, entity: Entity, rows: &[usize]) {
    assert!(can_move_rows(world, entity), "a component owns something and cannot be copied");
    let location = world.entity(entity).location();
    let components = world.entity(entity).archetype().components().to_vec();
    let sizes: Vec<_> = components
        .iter()
        .filter_map(|&id| Some((id, world.components().get_info(id)?.layout().size())))
        .collect();
    let cell = world.as_unsafe_world_cell();
    // SAFETY: the cell comes from `&mut World`, so that nothing else reads or writes its storages.
    let tables = unsafe { &cell.storages().tables };
    let Some(table) = tables.get(location.table_id) else { return };
    let ascending = rows.windows(2).all(|pair| pair[0] < pair[1]);
    assert!(ascending && rows.last().is_none_or(|&row| row < table.entity_count() as usize));
    for (id, size) in sizes {
        let Some(column) = table.get_column(id) else { continue };
        // SAFETY: the entity's own row exists, and the rows before it lie in front of it without gaps.
        let first = unsafe {
            let own = column.get_data_unchecked(location.table_row).as_ptr().cast_mut();
            own.sub(location.table_row.index() * size)
        };
        for (to, &from) in rows.iter().enumerate() {
            // SAFETY: both rows lie inside the column, whose values have this size and own nothing; the table
            // is borrowed mutably through `world`. Rows ascend, so `to <= from`, and `copy` allows overlap.
            unsafe { std::ptr::copy(first.add(from * size), first.add(to * size), size) };
        }
    }
}
