//! The length of a step from Bevy's fixed clock.

use crate::BodySystems;
use crate::body::forget_errors;
use bevy_app::{App, FixedFirst, FixedLast, FixedPostUpdate, FixedPreUpdate, FixedUpdate};
use bevy_ecs::intern::Interned;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::ScheduleLabel;
use bevy_time::{Fixed, Time};
use sinew::prelude::StepClock;

/// Where the length of a step comes from.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SinewTimestep {
    /// From `Time<Fixed>`, read before every step, while the steps are in a fixed schedule (default).
    #[default]
    Fixed,
    /// [`StepClock::dt`] as it is. Whoever sets that to another length than the last step had gets this mode by it. Where
    /// it differs from `Time<Fixed>`, tissue runs faster or slower than the app: a warning in the log says so once.
    ByHand,
}

pub(crate) fn build(app: &mut App, schedule: Interned<dyn ScheduleLabel>) {
    app.init_resource::<SinewTimestep>();
    let fixed = [
        FixedFirst.intern(),
        FixedPreUpdate.intern(),
        FixedUpdate.intern(),
        FixedPostUpdate.intern(),
        FixedLast.intern(),
    ];
    if fixed.contains(&schedule) {
        app.add_systems(schedule, read_clock.in_set(BodySystems::Build).before(forget_errors));
    }
}

/// What the last step left: its length, and whether the log was told of a difference.
type Known = (Option<f64>, bool);

fn read_clock(
    fixed: Option<Res<Time<Fixed>>>,
    clock: Option<ResMut<StepClock>>,
    mut mode: ResMut<SinewTimestep>,
    mut known: Local<Known>,
) {
    let (Some(fixed), Some(mut clock)) = (fixed, clock) else { return };
    let (last, told) = &mut *known;
    if *mode == SinewTimestep::Fixed && clock.dt != last.unwrap_or_else(|| StepClock::default().dt)
    {
        *mode = SinewTimestep::ByHand;
    }
    let period = fixed.delta_secs_f64();
    if period == 0.0 {
        return;
    }
    match *mode {
        SinewTimestep::Fixed => {
            if clock.dt != period {
                clock.dt = period;
            }
            *last = Some(period);
        }
        SinewTimestep::ByHand => {
            if clock.dt != period && !std::mem::replace(told, true) {
                log::warn!(
                    "`StepClock::dt` is {} s, set by hand, but `Time<Fixed>` makes a step every {period} s: tissue runs \
                     {:.3} times as fast as the app; leave `StepClock::dt` alone, or make both the same",
                    clock.dt,
                    clock.dt / period
                );
            }
            *last = Some(clock.dt);
        }
    }
}
