//! Pressures that nothing holds any more. The work of a follower pressure grows with the third power of displacements. Against an
//! energy of second degree the sum has no bound, and a step that lowers it is as good as any other.

use bevy_ecs::prelude::*;
use sinew_engine::load::{Pressure, PressureReach, SweptVolumes};
use sinew_engine::order::Order;
use sinew_engine::ratios::each_element;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StepClock, StepError};
use sinew_engine::topology::Topology;

/// Mean of deformed over rest volume or area above which a body has burst: no tissue and no rubber reaches it, and the work of the
/// pressure until then is at most so many times its value times the volume of the body.
pub const BURST: f64 = 100.0;

/// Whether the bodies that pressures act on are of a size that matter can have, at the displacements of the columns and the volumes
/// last swept. Bodies are measured only where a pressure swept more than the area of its faces times the extent of the body.
///
/// # Errors
/// When one is not.
pub(crate) fn check_pressures<S: Scalar>(world: &mut World) -> Result<(), StepError> {
    let found = world.get_resource::<SweptVolumes>().zip(world.get_resource::<PressureReach>());
    let far = found.map_or_else(Vec::new, |(swept, reach)| swept.beyond(reach));
    if far.is_empty() {
        return Ok(());
    }
    let mut pressures = world.query::<(&Order, &Pressure)>();
    let mut pressures: Vec<_> = pressures.iter(world).map(|(order, p)| (*order, p)).collect();
    pressures.sort_by_key(|(order, _)| *order);
    let bodies = &world.resource::<Topology>().bodies;
    let mut loaded = Vec::new();
    for (_, pressure) in far.iter().filter_map(|&place| pressures.get(place)) {
        let acts_on =
            |rows: &std::ops::Range<u32>| pressure.faces.iter().any(|f| rows.contains(&f[0].0));
        let own = bodies.iter().enumerate().filter(|(_, body)| acts_on(&body.vertices));
        loaded.extend(own.map(|(body, _)| (pressure.name.clone(), body)));
    }
    for (name, body) in loaded {
        let growth = growth::<S>(world, body);
        // what is no number has burst as well
        let within = growth <= BURST;
        if !within {
            let body = world.resource::<Topology>().bodies[body].name.clone();
            let time = world.resource::<StepClock>().time;
            return Err(StepError::Burst { name, body, time, growth });
        }
    }
    Ok(())
}

/// Mean magnitude of deformed over rest volume of the solid elements of a body, or of deformed over rest area of its membrane,
/// whichever is larger.
fn growth<S: Scalar>(world: &mut World, body: usize) -> f64 {
    let mut sums = [[0.0; 2]; 2];
    each_element::<S>(world, body, |element| {
        let [now, rest] = &mut sums[usize::from(element.kind.is_solid())];
        for (ratio, size) in element.ratios.iter().zip(element.sizes) {
            *now += ratio.abs() * size;
            *rest += size;
        }
    });
    let means = sums.map(|[now, rest]| if rest > 0.0 { now / rest } else { 0.0 });
    // the sum is no number where one of them is none
    if means.iter().any(|mean| mean.is_nan()) { f64::NAN } else { means[0].max(means[1]) }
}
