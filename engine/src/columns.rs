//! Table columns as slices. A query over components that live in one table hands out whole
//! columns; kernels see nothing else.

use crate::topology::ElementTables;
use bevy_ecs::archetype::ArchetypeId;
use bevy_ecs::component::{ComponentId, Mutable};
use bevy_ecs::prelude::{Component, Entity, EntityWorldMut, World};
use bevy_ecs::ptr::OwningPtr;
use bevy_ecs::query::QueryNotDenseError;
use std::mem::MaybeUninit;
use std::ptr::NonNull;

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
    let components = world.entity(entity).archetype().components().to_vec();
    let ascending = rows.windows(2).all(|pair| pair[0] < pair[1]);
    for id in components {
        let Some(RawColumn { first, size, rows: count }) = raw_column(world, entity, id) else {
            continue;
        };
        assert!(ascending && rows.last().is_none_or(|&row| row < count));
        for (to, &from) in rows.iter().enumerate() {
            // SAFETY: both rows lie inside the column, whose values have this size and own nothing; the table
            // is borrowed mutably through `world`. Rows ascend, so `to <= from`, and `copy` allows overlap.
            unsafe { std::ptr::copy(first.add(from * size), first.add(to * size), size) };
        }
    }
}

/// Spawns an entity with the same values as another, whatever laws or users put there.
///
/// # Panics
/// When [`can_move_rows`] says no.
pub fn copy_entity(world: &mut World, entity: Entity) -> Entity {
    assert!(can_move_rows(world, entity), "a component owns something and cannot be copied");
    let ids = world.entity(entity).archetype().components().to_vec();
    let mut values = Vec::with_capacity(ids.len());
    for &id in &ids {
        let layout = world.components().get_info(id).expect("it has this component").layout();
        assert!(layout.align() <= align_of::<u128>(), "its alignment is that of no number");
        let size = layout.size();
        let mut copy = vec![MaybeUninit::<u128>::uninit(); size.div_ceil(size_of::<u128>())];
        let own = world.entity(entity).get_by_id(id).expect("it has this component");
        // SAFETY: the value has that many bytes, the copy is as long, and neither is the other. Padding is copied as what
        // it is.
        unsafe {
            let to = copy.as_mut_ptr().cast::<MaybeUninit<u8>>();
            std::ptr::copy_nonoverlapping(own.as_ptr().cast(), to, size);
        }
        values.push(copy);
    }
    let mut new = world.spawn_empty();
    let pointers = values.iter_mut().map(|copy| {
        let first = NonNull::new(copy.as_mut_ptr().cast::<u8>()).unwrap_or(NonNull::dangling());
        // SAFETY: a valid value of its component, which owns nothing; columns of elements are aligned to 16 bytes at most
        unsafe { OwningPtr::new(first) }
    });
    // SAFETY: ids and values come in pairs, from an entity of this world.
    unsafe { new.insert_by_ids(&ids, pointers) };
    new.id()
}

/// Writes a column that an entity has, and nothing where it has none: an insertion, which could give it one, is much more code.
#[inline(never)]
pub fn set<C: Component<Mutability = Mutable>>(entity: &mut EntityWorldMut, value: C) {
    if let Some(mut own) = entity.get_mut::<C>() {
        *own = value;
    }
}

/// One column of a table.
struct RawColumn {
    first: *mut u8,
    /// Bytes of a value.
    size: usize,
    rows: usize,
}

/// The column of a component in the table that holds an entity. The pointer is good until the world changes.
fn raw_column(world: &mut World, entity: Entity, id: ComponentId) -> Option<RawColumn> {
    let location = world.entity(entity).location();
    let size = world.components().get_info(id)?.layout().size();
    let cell = world.as_unsafe_world_cell();
    // SAFETY: the cell comes from `&mut World`, so that nothing else reads or writes its storages.
    let table = unsafe { &cell.storages().tables }.get(location.table_id)?;
    let column = table.get_column(id)?;
    // SAFETY: the entity's own row exists, and the rows before it lie in front of it without gaps.
    let first = unsafe {
        let own = column.get_data_unchecked(location.table_row).as_ptr().cast_mut();
        own.sub(location.table_row.index() * size)
    };
    Some(RawColumn { first, size, rows: table.entity_count() as usize })
}

/// All values of the tables of vertices and elements as they once were, to put them back: whatever laws or users keep
/// there.
pub struct TableImage {
    tables: Vec<OneTable>,
}

struct OneTable {
    archetype: ArchetypeId,
    rows: usize,
    /// Components and their values, which own nothing; aligned for all of them.
    columns: Vec<(ComponentId, usize, Vec<MaybeUninit<u128>>)>,
}

impl TableImage {
    /// Copies the tables; `None` when a component of them owns something, or a table has rows of several kinds.
    ///
    /// ```
    /// # use bevy_ecs::prelude::*;
    /// # use sinew_engine::columns::TableImage;
    /// # use sinew_engine::vertex::{BodyId, RestPosition};
    /// # use glam::DVec3;
    /// let mut world = World::new();
    /// let row = |i: u32| (RestPosition(DVec3::splat(f64::from(i))), BodyId(i));
    /// world.spawn_batch((0..5).map(row));
    /// let image = TableImage::take(&mut world).unwrap();
    /// let last: Vec<Entity> = world.query::<Entity>().iter(&world).skip(2).collect();
    /// for entity in last.into_iter().rev() {
    ///     world.despawn(entity);
    /// }
    /// world.query::<&mut BodyId>().iter_mut(&mut world).for_each(|mut id| id.0 = 9);
    /// image.put_back(&mut world);
    /// let rows: Vec<_> = world.query::<(&BodyId, &RestPosition)>().iter(&world).map(|(b, x)| (b.0, x.0.x)).collect();
    /// assert_eq!(rows, [(0, 0.0), (1, 1.0), (2, 2.0), (3, 3.0), (4, 4.0)]);
    /// ```
    pub fn take(world: &mut World) -> Option<Self> {
        let mut tables = Vec::new();
        for archetype in ElementTables::of(world).archetypes() {
            let kind = world.archetypes().get(archetype)?;
            let Some(first) = kind.entities().first().map(|entity| entity.id()) else { continue };
            let (ids, rows) = (kind.components().to_vec(), kind.len() as usize);
            if !can_move_rows(world, first) {
                return None;
            }
            let mut columns = Vec::new();
            for id in ids {
                let column = raw_column(world, first, id)?;
                let align = world.components().get_info(id)?.layout().align();
                if column.rows != rows || align > align_of::<u128>() {
                    return None;
                }
                let bytes = rows * column.size;
                let mut copy =
                    vec![MaybeUninit::<u128>::uninit(); bytes.div_ceil(size_of::<u128>())];
                // SAFETY: the column has that many bytes, the copy is as long, and neither is the other. Padding is
                // copied as what it is, memory that may be uninitialised.
                unsafe {
                    let to = copy.as_mut_ptr().cast::<MaybeUninit<u8>>();
                    std::ptr::copy_nonoverlapping(column.first.cast(), to, bytes);
                }
                columns.push((id, column.size, copy));
            }
            tables.push(OneTable { archetype, rows, columns });
        }
        Some(Self { tables })
    }

    /// Puts the values back, in the world that they are from. Rows that are gone come back as new entities, those that came
    /// since at the end of a table go; ticks of changes stay as they are.
    pub fn put_back(&self, world: &mut World) {
        for table in &self.tables {
            let kind = world.archetypes().get(table.archetype);
            let mut now = kind.map_or(0, |kind| kind.len() as usize);
            while now > table.rows {
                let kind = world.archetypes().get(table.archetype);
                let last = kind.and_then(|kind| kind.entities().last()).map(|entity| entity.id());
                last.map(|entity| world.despawn(entity));
                now -= 1;
            }
            let ids: Vec<ComponentId> = table.columns.iter().map(|(id, ..)| *id).collect();
            while now < table.rows {
                let value = |(_, size, values): &(ComponentId, usize, Vec<MaybeUninit<u128>>)| {
                    let first = values.as_ptr().cast::<u8>().cast_mut();
                    // SAFETY: row `now` lies within the values of the column, which are aligned for its type, and they
                    // own nothing, so that what takes them over leaves a valid copy behind. Nobody writes through it.
                    unsafe {
                        OwningPtr::new(NonNull::new_unchecked(first.wrapping_add(now * size)))
                    }
                };
                let mut entity = world.spawn_empty();
                // SAFETY: ids and values come in pairs, from an entity of this world.
                unsafe { entity.insert_by_ids(&ids, table.columns.iter().map(value)) };
                now += 1;
            }
            let kind = world.archetypes().get(table.archetype);
            let Some(first) = kind.and_then(|kind| kind.entities().first()).map(|e| e.id()) else {
                continue;
            };
            for (id, size, values) in &table.columns {
                let Some(column) = raw_column(world, first, *id) else { continue };
                let bytes = table.rows * size;
                assert!(column.size == *size && column.rows == table.rows);
                // SAFETY: the column has these many bytes, so has the copy, and its values are of the column's type.
                unsafe {
                    let from = values.as_ptr().cast::<MaybeUninit<u8>>();
                    std::ptr::copy_nonoverlapping(from, column.first.cast(), bytes);
                }
            }
        }
    }
}
