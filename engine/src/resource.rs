//! Resources that are there as soon as somebody asks for them, and that systems take out while they work.

use bevy_ecs::component::Mutable;
use bevy_ecs::prelude::*;

/// The resource of a type, which begins as its default.
///
/// `World::init_resource` and `World::get_resource_or_init` do the same, but each compiles how entities are spawned for every type of
/// resource: three percent of the command, before this took their place.
///
/// ```
/// use bevy_ecs::prelude::*;
/// use sinew_engine::resource::ensure;
///
/// #[derive(Resource, Default)]
/// struct Count(u32);
///
/// let mut world = World::new();
/// ensure::<Count>(&mut world).0 += 1;
/// assert_eq!(ensure::<Count>(&mut world).0, 1);
/// ```
pub fn ensure<R: Resource<Mutability = Mutable> + Default>(world: &mut World) -> Mut<'_, R> {
    if !world.contains_resource::<R>() {
        world.insert_resource(R::default());
    }
    world.resource_mut::<R>()
}

/// The value of a resource, in whose place its default stays until [`put`]; the default of one that is not there. It counts as changed.
///
/// `World::remove_resource` and `World::resource_scope` move the entity that holds the resource to another table and back.
///
/// ```
/// use bevy_ecs::prelude::*;
/// use sinew_engine::resource::{put, take};
///
/// #[derive(Resource, Default)]
/// struct Names(Vec<&'static str>);
///
/// let mut world = World::new();
/// put(&mut world, Names(vec!["liver"]));
/// let names = take::<Names>(&mut world);
/// assert!(world.resource::<Names>().0.is_empty());
/// put(&mut world, names);
/// assert_eq!(world.resource::<Names>().0, ["liver"]);
/// ```
pub fn take<R: Resource<Mutability = Mutable> + Default>(world: &mut World) -> R {
    world.get_resource_mut::<R>().map_or_else(R::default, |mut own| std::mem::take(&mut *own))
}

/// Gives a resource a value; one that is not there is there from then on.
pub fn put<R: Resource<Mutability = Mutable> + Default>(world: &mut World, value: R) {
    *ensure::<R>(world) = value;
}
