//! The integrators as a table: one row each with the facts that the rest of the program asks for. Adding one is a row
//! here, its code, and its line in `Step::run` ([`crate::implicit`]) or in [`crate::explicit`].

use serde::{Deserialize, Serialize};
use sinew_contact::set::ContactSet;
use sinew_engine::step::StepError;

/// Facts of an integrator: a row of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IntegratorFacts {
    /// Name as in a scene file.
    pub name: &'static str,
    /// Moves bodies in time; otherwise it looks for equilibria and knows no inertia.
    pub dynamic: bool,
    /// Cuts steps below a stability limit and solves no linear system.
    pub explicit: bool,
    /// Solves a nonlinear system to convergence.
    pub converges: bool,
    /// Order of its error in the length of the step; 0 of equilibria.
    pub order: u32,
    /// Uses the last step, and where it cannot (first step, state set from outside) takes one of implicit
    /// Euler.
    pub multistep: bool,
    /// Can take over bodies with many inverted elements
    /// ([`SolverSettings::recovery`](crate::settings::SolverSettings::recovery)).
    pub recovers: bool,
    /// The total energy may rise, within bounds, without outside work. Otherwise it rises by rounding and the
    /// tolerances of the solves only.
    pub energy_swings: bool,
    /// Can iterate contact until nothing is left of the penetration ([`Tool::exact`](sinew_contact::tool::Tool::exact)).
    pub exact_contact: bool,
    /// Runs on the device too.
    pub device: bool,
    /// Advice to the user: a sentence without a full stop.
    pub caution: Option<&'static str>,
}

/// Implicit, solved to convergence, first order: what the rows of the table differ from.
const NEWTON: IntegratorFacts = IntegratorFacts {
    name: "newton",
    dynamic: true,
    explicit: false,
    converges: true,
    order: 1,
    multistep: false,
    recovers: false,
    energy_swings: false,
    exact_contact: false,
    device: false,
    caution: None,
};
const LINEARISED_BDF2: IntegratorFacts = IntegratorFacts {
    name: "linearised-bdf2",
    converges: false,
    order: 2,
    multistep: true,
    recovers: true,
    energy_swings: true,
    ..NEWTON
};
const SYMPLECTIC_EULER: IntegratorFacts = IntegratorFacts {
    name: "symplectic-euler",
    explicit: true,
    converges: false,
    energy_swings: true,
    device: true,
    ..NEWTON
};

/// Makes the enumeration and its table of one list, so that no variant can lack its row.
macro_rules! integrators {
    ($($(#[$about:meta])* $variant:ident: $row:expr;)*) => {
        /// Time integrator.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(rename_all = "kebab-case")]
        pub enum Integrator {
            $($(#[$about])* $variant,)*
        }

        impl Integrator {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$variant,)*];

            /// Its row of the table.
            pub const fn facts(self) -> &'static IntegratorFacts {
                match self {
                    $(Self::$variant => const { &$row },)*
                }
            }
        }
    };
}

integrators! {
    /// The solver's choice (default): [`Self::LinearisedBdf2`]; a static scene looks for equilibria, and on
    /// the device it is [`Self::Safe`].
    #[default]
    Auto: IntegratorFacts { name: "auto", device: true, ..LINEARISED_BDF2 };
    /// Linearised implicit Euler with line search and energy cap: one linear system a step, and the
    /// energy provably never rises between outside actions. First order.
    Safe: IntegratorFacts {
        name: "safe", converges: false, recovers: true, device: true, ..NEWTON
    };
    /// BDF2 linearised at `x_n + h v_n`, one linear system a step; a body for which that step fails
    /// its tests (tangent not positive definite, step shortened, energy above its budget) takes the
    /// safe step instead. Second order as long as the tests pass.
    LinearisedBdf2: LINEARISED_BDF2;
    /// Implicit Euler solved to convergence. First order.
    Newton: IntegratorFacts { exact_contact: true, ..NEWTON };
    /// BDF2 solved to convergence. Second order, damps high frequencies.
    Bdf2: IntegratorFacts { name: "bdf2", order: 2, multistep: true, ..NEWTON };
    /// TR-BDF2 solved to convergence, two solves a step. Second order, damps high frequencies, and
    /// needs no history.
    TrBdf2: IntegratorFacts { name: "tr-bdf2", order: 2, ..NEWTON };
    /// TR-BDF2 with one linear system a stage, two a step, each linearised where the velocities lead; it must pass the
    /// tests of [`Self::LinearisedBdf2`] or gives way to the safe step. Second order, keeps free motion best of all that
    /// solve few systems, and needs no history.
    LinearisedTrBdf2: IntegratorFacts { name: "linearised-tr-bdf2", multistep: false, ..LINEARISED_BDF2 };
    /// Implicit midpoint rule solved to convergence. Second order, keeps angular momentum; not robust:
    /// large steps make it gain energy without bound.
    ImplicitMidpoint: IntegratorFacts {
        name: "implicit-midpoint",
        order: 2,
        caution: Some(
            "the implicit midpoint rule gains energy without bound where steps are too large",
        ),
        ..NEWTON
    };
    /// Equilibrium at the loads and constraints of the step's end; no inertia.
    QuasiStatic: IntegratorFacts {
        name: "quasi-static", dynamic: false, order: 0, exact_contact: true, ..NEWTON
    };
    /// Symplectic Euler, substepped below the stability limit.
    SymplecticEuler: SYMPLECTIC_EULER;
    /// Störmer-Verlet (velocity form), substepped below the stability limit.
    StormerVerlet: IntegratorFacts { name: "stormer-verlet", order: 2, ..SYMPLECTIC_EULER };
}

impl Integrator {
    /// Name as in a scene file.
    pub fn name(self) -> &'static str {
        self.facts().name
    }

    /// What `Auto` stands for.
    pub fn resolve(self) -> Self {
        if self == Self::Auto { Self::LinearisedBdf2 } else { self }
    }

    /// Whether it cuts steps below a stability limit and solves no linear system.
    pub fn is_explicit(self) -> bool {
        self.facts().explicit
    }

    /// Whether it can take over bodies with many inverted elements
    /// ([`SolverSettings::recovery`](crate::settings::SolverSettings::recovery)).
    pub fn recovers(self) -> bool {
        self.facts().recovers
    }

    /// What is wrong with a tool that wants no penetration, if anything.
    pub fn exact_contact_problem(self) -> Option<String> {
        let can = |integrator: &Self| integrator.facts().exact_contact;
        (!can(&self)).then(|| {
            let names = Self::ALL.iter().filter(|i| can(i)).map(|i| i.name());
            let names = names.collect::<Vec<_>>().join(" and ");
            format!("exact contact is for the integrators {names}, not {}", self.name())
        })
    }

    /// Refuses contact that it does not resolve.
    pub(crate) fn check_contact(self, contact: &ContactSet) -> Result<(), StepError> {
        match contact.exact_tool().zip(self.exact_contact_problem()) {
            None => Ok(()),
            Some((name, problem)) => Err(StepError::InvalidContact { name: name.into(), problem }),
        }
    }

    /// Whether it solves a nonlinear system to convergence.
    pub fn converges(self) -> bool {
        self.facts().converges
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_scene_files() {
        for &integrator in Integrator::ALL {
            let name = serde::de::value::StrDeserializer::<serde::de::value::Error>::new(
                integrator.name(),
            );
            assert_eq!(Integrator::deserialize(name), Ok(integrator));
        }
    }

    #[test]
    fn auto_has_the_facts_of_what_it_stands_for() {
        let facts = Integrator::Auto.resolve().facts();
        let auto =
            IntegratorFacts { name: facts.name, device: facts.device, ..*Integrator::Auto.facts() };
        assert_eq!(auto, *facts);
    }
}
