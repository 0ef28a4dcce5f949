//! Resources that are there as soon as somebody asks for them.

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
