//! Messages about what looks unintended.

use crate::BodySystems;
use bevy_app::App;
use bevy_ecs::intern::Interned;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::ScheduleLabel;
use sinew::engine::step::StepClock;
use sinew::engine::topology::Topology;
use sinew::warning::{Level, Warning, warnings};

/// Something looks unintended in the mesh or material of a body, or was not as it should be in a step that was carried out.
/// Sent, and written to the log, when it is found for the first time; [`warnings`] has the counts so far.
#[derive(Message, Clone, Debug, PartialEq)]
pub struct SinewWarning(pub Warning);

pub(crate) fn build(app: &mut App, schedule: Interned<dyn ScheduleLabel>) {
    app.add_message::<SinewWarning>();
    // it reads what others in the set leave alone
    app.add_systems(schedule, tell_warnings.in_set(BodySystems::State).ambiguous_with_all());
}

/// Steps and bodies that were looked at, and what was told: code and subject.
type Told = ((u64, usize), Vec<(String, String)>);

fn tell_warnings(world: &mut World, mut told: Local<Told>) {
    let (Some(clock), Some(topology)) =
        (world.get_resource::<StepClock>(), world.get_resource::<Topology>())
    else {
        return;
    };
    let now = (clock.step, topology.bodies.len());
    if std::mem::replace(&mut told.0, now) == now {
        return;
    }
    for warning in warnings(world) {
        let own = (warning.code.clone(), warning.subject.clone());
        if told.1.contains(&own) {
            continue;
        }
        told.1.push(own);
        match warning.level {
            Level::Warning => log::warn!("{warning}"),
            Level::Note => log::info!("{warning}"),
        }
        world.write_message(SinewWarning(warning));
    }
}
