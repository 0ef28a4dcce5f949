//! Removals that a schedule carries out.

use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_engine::kept::with_query;
use sinew_engine::order::Order;
use sinew_engine::resource::ensure;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{StepSchedule, StepSystems};
use sinew_engine::step::may_edit;

use super::remove::{Removal, remove_batch};
use super::report::{RemovalError, RemovalReport};

/// Asks for a removal in [`StepSystems::Edit`] of the next step; the entity is despawned then.
/// Requests are carried out in the order in which they came.
#[derive(Component, Clone, Debug, PartialEq, Serialize, Deserialize)]
#[require(Order)]
pub struct RemovalRequest {
    /// Index into [`Topology::bodies`](sinew_engine::topology::Topology::bodies).
    pub body: usize,
    /// What to remove.
    pub removal: Removal,
}

impl RemovalRequest {
    /// Asks for a removal from the body at an index of [`Topology::bodies`](sinew_engine::topology::Topology::bodies).
    pub fn new(body: usize, removal: Removal) -> Self {
        Self { body, removal }
    }
}

/// What came of the [`RemovalRequest`]s of the last step, with the index of the body: a report for every
/// batch, after the errors of its requests. A request that fails changes nothing and does not stop the
/// step; an element of a list that an earlier request of the batch takes counts as removed.
#[derive(Resource, Clone, Debug, Default)]
pub struct RemovalLog(pub Vec<(usize, Result<RemovalReport, RemovalError>)>);

/// Puts the system that carries out [`RemovalRequest`]s into the step, once.
pub(crate) fn install<S: Scalar>(world: &mut World) {
    if world.contains_resource::<RemovalLog>() {
        return;
    }
    ensure::<RemovalLog>(world);
    if let Some(mut schedules) = world.get_resource_mut::<Schedules>() {
        let requests = apply_removal_requests::<S>.in_set(StepSystems::Edit).in_set(Requests);
        schedules.entry(StepSchedule).add_systems(requests);
    }
}

/// The system that carries out what was asked for.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Requests;

fn apply_removal_requests<S: Scalar>(world: &mut World) {
    world.resource_mut::<RemovalLog>().0.clear();
    let mut requests =
        with_query::<(&Order, Entity, &RemovalRequest), (), _>(world, |world, all| {
            all.iter(world).map(|(o, e, r)| (*o, e, r.clone())).collect::<Vec<_>>()
        });
    if requests.is_empty() || !may_edit::<S>(world) {
        return;
    }
    requests.sort_unstable_by_key(|(order, entity, _)| (*order, *entity));
    let mut requests =
        requests.into_iter().map(|(_, entity, request)| (entity, request)).peekable();
    while let Some((entity, RemovalRequest { body, removal })) = requests.next() {
        world.despawn(entity);
        let mut regions = vec![removal.region];
        let same = |r: &RemovalRequest| r.body == body && r.removal.mass == removal.mass;
        while let Some((entity, next)) = requests.next_if(|(_, request)| same(request)) {
            world.despawn(entity);
            regions.push(next.removal.region);
        }
        let results = remove_batch::<S>(world, body, &regions, removal.mass);
        let log = &mut world.resource_mut::<RemovalLog>().0;
        log.extend(results.into_iter().map(|result| (body, result)));
    }
}
