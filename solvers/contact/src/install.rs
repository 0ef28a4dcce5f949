//! When a world gets its [`ContactSet`].

use crate::pair::BodyContact;
use crate::pull::Pull;
use crate::set::ContactSet;
use crate::thread::{Clip, Thread};
use crate::tool::Tool;
use bevy_ecs::prelude::*;
use sinew_engine::resource::ensure;

/// Lets a world have its [`ContactSet`] from its first tool, contact, pull, thread or clip on.
pub fn install(world: &mut World) {
    watch::<Tool>(world);
    watch::<BodyContact>(world);
    watch::<Pull>(world);
    watch::<Thread>(world);
    watch::<Clip>(world);
}

fn watch<C: Component>(world: &mut World) {
    let component = world.register_component::<C>();
    if world.archetypes().iter().any(|archetype| archetype.contains(component)) {
        // hooks can be set only before the first of a kind
        ensure::<ContactSet>(world);
        return;
    }
    world.register_component_hooks::<C>().try_on_add(|mut world, _| {
        world.commands().queue(|world: &mut World| {
            ensure::<ContactSet>(world);
        });
    });
}
