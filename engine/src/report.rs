//! What a step has to tell.

use crate::vertex::BodyId;
use bevy_ecs::prelude::Resource;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::time::Duration;

/// Rules by which two figures become one: that of the later part of a step or of all bodies so far, and another one.
macro_rules! rule {
    (own $own:expr, $other:expr) => {};
    (other $own:expr, $other:expr) => {
        $own.clone_from(&$other)
    };
    (sum $own:expr, $other:expr) => {
        $own += $other
    };
    (vector $own:expr, $other:expr) => {
        (0..3).for_each(|k| $own[k] += $other[k])
    };
    (max $own:expr, $other:expr) => {
        $own = $own.max($other)
    };
    (any $own:expr, $other:expr) => {
        $own |= $other
    };
    // counts parts
    (part $own:expr, $other:expr) => {
        $own = $other + 1
    };
    // a table of its own
    (table $own:expr, $other:expr) => {
        $own.follow(&$other)
    };
}

/// A table of figures: name, type, and the rule by which those of the parts of a step become one. In brackets also the rule
/// for those of bodies that are computed apart, and `total` where they are summed over the steps of a run too.
macro_rules! figures {
    ($(#[$about:meta])* pub struct $name:ident summed to $totals:ident {
        $($(#[$doc:meta])* pub $field:ident: $type:ty => [$parts:ident $bodies:ident $($total:ident)?],)*
    }) => {
        figures! {
            $(#[$about])*
            pub struct $name { $($(#[$doc])* pub $field: $type => $parts,)* }
        }
        figures! { $totals of $name {} $($field [$($total)?])* }

        impl $name {
            /// The report of a step in parts: this is that of the last part, `before` that of all earlier ones.
            #[must_use]
            pub fn after(&self, before: &Self) -> Self {
                let mut all = self.clone();
                all.follow(before);
                all
            }

            /// Adds the figures of a body that is computed apart from others.
            pub fn add_body(&mut self, body: &Self) {
                $(rule!($bodies self.$field, body.$field);)*
            }
        }
    };
    ($(#[$about:meta])* pub struct $name:ident {
        $($(#[$doc:meta])* pub $field:ident: $type:ty => $parts:ident,)*
    }) => {
        $(#[$about])*
        pub struct $name { $($(#[$doc])* pub $field: $type,)* }

        impl $name {
            /// Takes in figures of the earlier parts of the same step.
            fn follow(&mut self, before: &Self) {
                $(rule!($parts self.$field, before.$field);)*
            }
        }
    };
    ($totals:ident of $name:ident {$($done:ident)*} $field:ident [] $($rest:tt)*) => {
        figures! { $totals of $name {$($done)*} $($rest)* }
    };
    ($totals:ident of $name:ident {$($done:ident)*} $field:ident [total] $($rest:tt)*) => {
        figures! { $totals of $name {$($done)* $field} $($rest)* }
    };
    ($totals:ident of $name:ident {$($done:ident)*}) => {
        #[doc = concat!("Figures of [`", stringify!($name), "`] summed over steps.")]
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        pub struct $totals {
            $(#[doc = concat!("Sum of [`", stringify!($name), "::", stringify!($done), "`].")]
            pub $done: u64,)*
        }

        impl $totals {
            /// Adds a step.
            pub fn add(&mut self, step: &$name) {
                $(self.$done += u64::from(step.$done);)*
            }
        }
    };
}

figures! {
    /// Figures of the last step, written by the integrator.
    #[derive(Resource, Clone, Debug, Default, Serialize, Deserialize)]
    pub struct StepReport summed to StepTotals {
        /// Newton iterations (linear systems) of the step.
        pub newton_iterations: u32 => [sum max total],
        /// Conjugate-gradient iterations, all linear systems together.
        pub cg_iterations: u32 => [sum sum total],
        /// Linear solves that stopped at the iteration cap.
        pub cg_caps: u32 => [sum sum total],
        /// Relative residual of the last linear solve.
        pub cg_residual: f64 => [max max],
        /// Preconditioner of the last linear solve, empty without one.
        pub preconditioner: Cow<'static, str> => [own other],
        /// Times the values of preconditioners were computed anew; other solves used those of earlier
        /// ones.
        pub preconditioner_refreshes: u32 => [sum sum total],
        /// Incomplete factorisations of parts of a body that broke down and were repeated with weaker
        /// couplings.
        pub preconditioner_breakdowns: u32 => [sum sum total],
        /// Linear solves that mixed precision could not bring to the tolerance and full precision took
        /// over.
        pub precision_fallbacks: u32 => [sum own total],
        /// Newton ended at its iteration cap without reaching the tolerance.
        pub unconverged: bool => [any own],
        /// Length of the last Newton step over body size.
        pub newton_step: f64 => [own max],
        /// Times the projected tangent was used: the exact one was indefinite, or elements inverted.
        pub projections: u32 => [sum sum total],
        /// Elements clamped in those.
        pub clamped_elements: u64 => [sum own total],
        /// Halvings of the line search.
        pub backtracks: u32 => [sum sum total],
        /// Linear solves replaced by the preconditioned gradient, because even the projected tangent gave
        /// no descent.
        pub gradient_fallbacks: u32 => [sum sum total],
        /// Line searches that found no decrease: the body stays where it was, and in a dynamic step comes
        /// to a halt there.
        pub line_search_failures: u32 => [sum sum total],
        /// The energy cap scaled the velocity.
        pub energy_caps: u32 => [sum sum total],
        /// Bodies that took a linearised BDF2 step.
        pub second_order_steps: u32 => [sum own total],
        /// Bodies that did not.
        pub fallbacks: Fallbacks => [table own],
        /// Bodies that slept: at rest, with nothing near, and left where they are.
        pub sleeping: u32 => [own sum total],
        /// Bodies that moved by the corotational energy to recover from inversion.
        pub recovering: u32 => [own sum total],
        /// Elastic energy (J) that changing to that energy and back added.
        pub recovery_energy: f64 => [sum sum],
        /// Bodies that have many inverted elements but do not recover: loads crush them.
        pub recoveries_refused: u32 => [sum sum total],
        /// Bodies whose recovery took too long and was given up in this step; they move by their own law again.
        pub recoveries_given_up: u32 => [sum sum total],
        /// Parts in which the equilibrium was found.
        pub load_parts: u32 => [own own],
        /// Times a part of the loads was halved, because Newton did not converge or turned elements inside out.
        pub load_partings: u32 => [own own total],
        /// Explicit substeps.
        pub substeps: u32 => [own max total],
        /// Steps repeated with more substeps because the energy grew.
        pub refinements: u32 => [own max total],
        /// Largest stable explicit step (s), 0 when not estimated.
        pub stable_step: f64 => [own own],
        /// Distance of the accepted decrease of the incremental potential from what the linearised step
        /// predicted, relative: 0 for a step in which linearisation is exact, near 1 when it says little.
        pub linearisation_error: f64 => [max max],
        /// Elastic energy (J) at the end of the step.
        pub elastic_energy: f64 => [own sum],
        /// Kinetic energy (J) at the end of the step, held vertices included.
        pub kinetic_energy: f64 => [own sum],
        /// Work (J) of gravity and loads during the step: along the way for explicit integrators, the loads
        /// of the step's end acting all the way for implicit ones. 0 for equilibria.
        pub load_work: f64 => [sum sum],
        /// Work (J) of the constraints. Explicit integrators integrate the reaction along the way.
        /// Implicit ones book the energy it takes to move the held vertices at once, the rest following
        /// after: an upper bound, which the step then dissipates down to. 0 for equilibria.
        pub constraint_work: f64 => [sum sum],
        /// Energy (J) that went away during the step: kinetic and elastic energy at its start plus work,
        /// less both energies at its end. Damping and the integrator's own dissipation; 0 for equilibria.
        pub dissipation: f64 => [sum sum],
        /// The part of it that Rayleigh damping took (J), by its power at the end of the step, for explicit
        /// integrators by the mean of both ends. The rest is the integrator's.
        pub damping_dissipation: f64 => [sum sum],
        /// Total momentum of the step end (kg m/s).
        pub momentum: [f64; 3] => [own vector],
        /// Total angular momentum about the origin at the step end (kg m^2/s).
        pub angular_momentum: [f64; 3] => [own vector],
        /// Force evaluations of any kind.
        pub evaluations: u32 => [sum sum total],
        /// Contact with tools and between bodies.
        pub contact: ContactFigures => [table own],
    }
}

figures! {
    /// What contact did in a step; all 0 in a world without.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
    pub struct ContactFigures {
        /// Points in contact at the end of the step.
        pub points: u32 => own,
        /// Those of them that stick.
        pub sticking: u32 => own,
        /// Iterations of the inner loop of all bodies: linear systems with the contact of the last iterate.
        pub inner_iterations: u32 => sum,
        /// Inner loops that ended at their cap.
        pub unconverged: u32 => sum,
        /// Whether something touched or pulled in a step that did not converge: Newton's iteration or contact was not found, or
        /// a body was halted. Forces are not to be relied on then.
        pub missed: bool => any,
        /// Largest penetration (m).
        pub depth: f64 => own,
        /// Largest penetration over the mean edge of the surface.
        pub depth_over_edge: f64 => own,
        /// Parts in which the step was made because a tool was fast.
        pub substeps: u32 => part,
        /// Tools that did not reach their target.
        pub lagging: u32 => own,
        /// By how much (m) the worst of them is behind.
        pub lag: f64 => own,
        /// Parts of tools, and contacts of bodies, that appeared with something inside of a body and are drawn in until it has
        /// made way.
        pub drawn_in: u32 => sum,
        /// Points too deep inside of another body to tell its sides, which are left out, and tools wholly inside of a body.
        pub buried: u32 => own,
        /// Parts of tools that went through the surface of a body, and touch nothing of it until they are out.
        pub pierced: u32 => own,
        /// Bodies that took the safe step because of an impact.
        pub impacts: u32 => sum,
        /// Energy (J) stored in contacts and pulls at the end of the step. It is no part of the elastic energy.
        pub energy: f64 => own,
        /// Energy (J) that moving tools and pulls put into their contacts at the start of the step, with the bodies
        /// where they were: an upper bound of their work, which the step then dissipates down to.
        pub work: f64 => sum,
        /// Energy (J) that friction took.
        pub friction_dissipation: f64 => sum,
    }
}

figures! {
    /// Bodies that took the safe step instead of linearised BDF2, by reason. Integrators that converge BDF2
    /// count their first steps under `start`.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub struct Fallbacks {
        /// There is no history: first step, state, held axes or masses changed, much other step length.
        pub start: u32 => sum,
        /// The tangent was not positive definite.
        pub indefinite: u32 => sum,
        /// The full step did not lower the incremental potential enough.
        pub shortened: u32 => sum,
        /// The energy would have gone above its budget.
        pub energy: u32 => sum,
        /// An element would have been turned inside out.
        pub inverted: u32 => sum,
        /// A step shortly before failed, or elements are inverted.
        pub waiting: u32 => sum,
    }
}

/// Volume ratios J at the end of the step.
#[derive(Resource, Clone, Debug, Serialize, Deserialize)]
pub struct VolumeReport {
    /// Smallest deformed volume over rest volume, of hexahedra at their Gauss points.
    pub smallest_ratio: f64,
    /// Tetrahedra, and hexahedra of some Gauss point, with J <= 0.
    pub inverted: u64,
    /// The same for each body.
    pub inverted_by_body: Vec<u64>,
    /// Smallest ratio of each body.
    pub smallest_by_body: Vec<f64>,
    /// Tetrahedra and hexahedra of each body.
    pub elements_by_body: Vec<u64>,
    /// Largest magnitude of the mean of `J - 1` over a cluster: tetrahedra that keep their volume together, or one element
    /// that keeps the mean of its points; 0 without any. Of such elements only means are kept: the ratios above need not be
    /// near 1.
    pub largest_mean_change: f64,
}

impl Default for VolumeReport {
    fn default() -> Self {
        Self {
            smallest_ratio: f64::INFINITY,
            inverted: 0,
            inverted_by_body: Vec::new(),
            smallest_by_body: Vec::new(),
            elements_by_body: Vec::new(),
            largest_mean_change: 0.0,
        }
    }
}

impl VolumeReport {
    /// Starts a measurement of so many bodies; those that are `kept` stay as they were.
    pub(crate) fn clear(&mut self, bodies: usize, kept: impl Fn(usize) -> bool) {
        (self.smallest_ratio, self.inverted) = (f64::INFINITY, 0);
        self.largest_mean_change = 0.0;
        self.inverted_by_body.resize(bodies, 0);
        self.elements_by_body.resize(bodies, 0);
        self.smallest_by_body.resize(bodies, f64::INFINITY);
        for body in 0..bodies {
            let known = (
                self.smallest_by_body[body],
                self.inverted_by_body[body],
                self.elements_by_body[body],
            );
            self.smallest_by_body[body] = f64::INFINITY;
            (self.inverted_by_body[body], self.elements_by_body[body]) = (0, 0);
            if kept(body) {
                let (smallest, inverted, count) = known;
                self.add(BodyId(body as u32), smallest, inverted, count);
            }
        }
    }

    /// Adds `count` elements of a body: their smallest ratio, and how many are inverted.
    pub(crate) fn add(&mut self, body: BodyId, smallest: f64, inverted: u64, count: u64) {
        let body = body.0 as usize;
        self.smallest_ratio = self.smallest_ratio.min(smallest);
        self.inverted += inverted;
        self.inverted_by_body[body] += inverted;
        self.smallest_by_body[body] = self.smallest_by_body[body].min(smallest);
        self.elements_by_body[body] += count;
    }
}

/// Area ratios of membranes at the end of the step; a world without membranes does not have it.
///
/// A membrane triangle that is turned over is no error, so there is nothing to count.
#[derive(Resource, Clone, Copy, Debug, Serialize, Deserialize)]
pub struct AreaReport {
    /// Smallest deformed area over rest area; never negative.
    pub smallest_ratio: f64,
}

impl Default for AreaReport {
    fn default() -> Self {
        Self { smallest_ratio: f64::INFINITY }
    }
}

/// Host time spent in each system since the start, in order of first appearance.
#[derive(Resource, Clone, Debug, Default, Serialize)]
pub struct SystemTimes {
    /// One entry per system or stage.
    pub entries: Vec<SystemTime>,
}

/// Time spent in one system.
#[derive(Clone, Debug, Serialize)]
pub struct SystemTime {
    /// System, law or stage.
    pub name: &'static str,
    /// Total host time (s).
    pub seconds: f64,
    /// Number of runs.
    pub runs: u64,
}

impl SystemTimes {
    /// Books a run.
    pub fn add(&mut self, name: &'static str, time: Duration) {
        let seconds = time.as_secs_f64();
        match self.entries.iter_mut().find(|e| e.name == name) {
            Some(entry) => {
                entry.seconds += seconds;
                entry.runs += 1;
            }
            None => self.entries.push(SystemTime { name, seconds, runs: 1 }),
        }
    }
}
