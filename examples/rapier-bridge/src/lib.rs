//! Rigid bodies of rapier and tissue of Sinew in one program.
//!
//! One-way, a tool or a patch of tissue goes where a rigid body goes. Two-way, the rigid body gets the wrench back. A wrench
//! that comes a step later makes light bodies unstable, so the rigid body is part of the implicit step of the tissue here:
//!
//! Without tissue a point of the rigid body would be at `y` at the end of the step of `h`. Forces `f` on its points take them to
//! `y + h^2 W f`, where `W = J M^-1 J^T` is their mobility. A spring of compliance `C` between tissue and the true points is thus one
//! of compliance `C + h^2 W` between tissue and `y`, which is known: softer springs to `y` make the implicit step of both.
//! The engine's springs do not act on each other. Their compliances are a diagonal `D^-1` instead of that matrix, and the
//! compliance of the coupling is `D^-1 - h^2 W`. It has no negative eigenvalue if `h^2` times the largest one of `M^-1/2 J^T D J M^-1/2` is at
//! most 1, which is how stiffnesses are chosen ([`Link::mobility`]). Then the step is as stable as that of the tissue alone.
//!
//! The rigid body gets the impulse `h f` of the forces at the end of the step. With the integrator `newton` that is what the
//! tissue loses, so that the linear momentum of both stays to rounding. Angular momentum does not: it was off by 0.1 % after 1 s of an
//! off-centre pair. Joints and contacts of rapier answer to the wrench in rapier's step, not in that of the tissue.

use bevy_ecs::entity::Entity;
use glam::{DQuat, DVec3};
use rapier3d_f64::na::{Matrix3, Matrix3x6, Matrix6, SymmetricEigen, Vector3};
use rapier3d_f64::prelude::{
    PhysicsWorld, Pose as RigidPose, RigidBody, RigidBodyHandle, RigidBodyType, RigidBodyVelocity,
};
use sinew::engine::step::StepError;
use sinew::prelude::{
    BodyHandle, Integrator, Pose, Pull, Simulation, SolverSettings, StepClock, Tool, ToolPose,
};
use sinew::simulation::SimulationError;
use sinew::touch::pull::PullReport;
use sinew::touch::tool::{Stiffness, ToolError, ToolReport};

/// Who follows whom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coupling {
    /// The tissue follows the rigid body, which feels nothing. Exact for kinematic and fixed bodies; a dynamic one is
    /// followed to where velocity and forces lead.
    OneWay,
    /// The rigid body feels the tissue.
    TwoWay,
}

/// What is attached to a rigid body.
#[derive(Clone, Debug)]
pub enum Attached {
    /// A tool whose origin and axes are those of the rigid body; its `start` is not used. Two-way, contact is at most as stiff
    /// as the body can answer if all of a side touches. That is exact for flat sides. Round tips that are light sink in, by
    /// millimetres at 10 ms: give them a stiff body of their own as tip, and hold that as a patch.
    Tool(Box<Tool>),
    /// A patch of a body that springs hold where it is now, seen from the rigid body.
    Patch {
        /// Name for errors.
        name: String,
        /// Body of tissue.
        body: BodyHandle,
        /// Vertices of its mesh.
        vertices: Vec<u32>,
        /// Stiffness (N/m) of all springs together.
        stiffness: f64,
    },
}

/// What cannot be coupled.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BridgeError {
    /// The handle names no rigid body.
    #[error("`{0}`: there is no rigid body {1:?}; use what `insert` of the same world returned")]
    NoBody(String, RigidBodyHandle),
    /// The body has gone since.
    #[error("`{0}`: its rigid body {1:?} was removed; detach link {2}, then attach it anew")]
    Removed(String, RigidBodyHandle, usize),
    /// The number names no body of tissue.
    #[error("`{0}`: the tissue has no body {1}; use what `add_body` of it returned")]
    NoTissue(String, usize),
    /// The tool or pull has gone since.
    #[error("`{0}` was removed from the tissue; detach link {1}")]
    Released(String, usize),
    /// A pose, velocity or force is not finite.
    #[error(
        "`{0}`: the {1} of its rigid body is not finite; nothing was moved: set it, or detach the link"
    )]
    NotFinite(String, &'static str),
    /// Nothing can feel.
    #[error(
        "`{0}`: a rigid body that does not move by forces feels no tissue; make it dynamic, with a mass, or couple one-way"
    )]
    NotDynamic(String),
    /// The shape tells no bound on what may touch it.
    #[error(
        "tool `{0}`: two-way coupling needs parts with bounds and no edge or needle; couple it one-way"
    )]
    Unbounded(String),
    /// A stiffness.
    #[error("`{0}`: its stiffness is {1} N/m; it must be positive and finite")]
    Stiffness(String, f64),
    /// Both programs must make the same step.
    #[error(
        "steps of {tissue} s in the tissue and of {rigid} s in rapier; call `set_dt`, or set `integration_parameters.dt`"
    )]
    Steps {
        /// Step (s) of the tissue.
        tissue: f64,
        /// Step (s) of rapier.
        rigid: f64,
    },
    /// Forces at the end of its step are not what it gives over the step.
    #[error(
        "integrator \"{0}\" does not balance momentum in two-way coupling; call `set_solver` with `Integrator::Newton`"
    )]
    Integrator(&'static str),
    /// A tool.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// A vertex.
    #[error(transparent)]
    Tissue(#[from] SimulationError),
    /// The step of the tissue, which was undone. Rapier did not step.
    #[error(transparent)]
    Step(#[from] StepError),
}

/// One thing that is attached, and what it felt in the last step.
#[derive(Clone, Debug)]
pub struct Link {
    /// Name of the tool or patch.
    pub name: String,
    /// Rigid body.
    pub rigid: RigidBodyHandle,
    /// Tool or pull.
    pub entity: Entity,
    /// Who follows whom.
    pub coupling: Coupling,
    /// Stiffness that was asked for: of a patch (N/m), of contact (Pa/m); infinite where the mass alone decides.
    pub stiffness: f64,
    /// Largest eigenvalue of `M^-1/2 J^T D J M^-1/2` for unit stiffness: 1/kg of a patch, m^2/kg of contact. Masses and locked axes are
    /// those at the time of attaching.
    pub mobility: f64,
    /// Force (N) on the rigid body.
    pub force: DVec3,
    /// Torque (N m) on it about its centre of mass.
    pub torque: DVec3,
    /// False after a step whose force is not its impulse: contact was not solved, or the tissue cut the step into parts.
    pub balanced: bool,
    /// Pose of the rigid body at which a patch was attached, and its centre of mass (m) there.
    rest: Option<(RigidPose, DVec3)>,
    /// Centre of mass (m) without tissue at the end of the step.
    centre: DVec3,
}

/// Couples rigid bodies to tissue.
#[derive(Clone, Debug, Default)]
pub struct Bridge {
    links: Vec<Option<Link>>,
}

impl Bridge {
    /// Attaches a tool or a patch to a rigid body; the number identifies the link.
    ///
    /// # Errors
    /// When there is no such body, it is not finite or cannot feel what it is to feel, or the tool or patch cannot be used.
    pub fn attach(
        &mut self,
        tissue: &mut Simulation,
        world: &mut PhysicsWorld,
        rigid: RigidBodyHandle,
        what: Attached,
        coupling: Coupling,
    ) -> Result<usize, BridgeError> {
        let name = match &what {
            Attached::Tool(tool) => tool.name.clone(),
            Attached::Patch { name, .. } => name.clone(),
        };
        let Some(body) = world.bodies.get_mut(rigid) else {
            return Err(BridgeError::NoBody(name, rigid));
        };
        // rapier finds masses in the first step
        body.recompute_mass_properties_from_colliders(&world.colliders);
        check_finite(&name, body)?;
        let two_way = coupling == Coupling::TwoWay;
        if two_way && !(body.is_dynamic() && body.mass() > 0.0 && body.mass().is_finite()) {
            return Err(BridgeError::NotDynamic(name));
        }
        let pose = *body.position();
        let (rest, centre) = (Some((pose, body.center_of_mass())), body.center_of_mass());
        let (entity, stiffness, mobility, rest) = match what {
            Attached::Tool(mut tool) => {
                tool.start = tool_pose(&pose);
                if let Some(problem) = tool.problem(tissue.topology().vertex_count()) {
                    return Err(ToolError::Invalid { name, problem }.into());
                }
                let stiffness = match tool.stiffness {
                    Stiffness::Absolute(stiffness) => stiffness,
                    Stiffness::Relative(_) => f64::INFINITY,
                };
                let mobility = if two_way { tool_mobility(&tool, body)? } else { 0.0 };
                (tissue.add_tool(*tool)?, stiffness, mobility, None)
            }
            Attached::Patch { name, body: of, vertices, stiffness } => {
                if !(stiffness > 0.0 && stiffness.is_finite()) {
                    return Err(BridgeError::Stiffness(name, stiffness));
                }
                if of.0 >= tissue.topology().bodies.len() {
                    return Err(BridgeError::NoTissue(name, of.0));
                }
                let rows = tissue.rows(of, &name, &vertices)?;
                let places = tissue.positions(of);
                let share = 1.0 / vertices.len() as f64;
                let block = Matrix3::identity() * share;
                let points = vertices.iter().map(|&v| (places[v as usize] - centre, block));
                let mobility = if two_way { mobility(body, points) } else { 0.0 };
                let pull = tissue.add_pull(Pull::new(name, rows, stiffness, 0.0));
                (pull, stiffness, mobility, rest)
            }
        };
        let (force, torque, balanced) = (DVec3::ZERO, DVec3::ZERO, true);
        self.links.push(Some(Link {
            name,
            rigid,
            entity,
            coupling,
            stiffness,
            mobility,
            force,
            torque,
            balanced,
            rest,
            centre,
        }));
        Ok(self.links.len() - 1)
    }

    /// Takes a link and its tool or pull away; whether there was one.
    pub fn detach(&mut self, tissue: &mut Simulation, link: usize) -> bool {
        let found = self.links.get_mut(link).and_then(Option::take);
        found.is_some_and(|link| tissue.remove_contact(link.entity))
    }

    /// A link and what it felt in the last step.
    pub fn link(&self, link: usize) -> Option<&Link> {
        self.links.get(link)?.as_ref()
    }

    /// Makes a step of both. Forces that the program added to rigid bodies act as they do in rapier, and stay.
    ///
    /// # Errors
    /// When a body or tool has gone or is not finite, or the tissue cannot step. Neither has stepped then.
    pub fn step(
        &mut self,
        tissue: &mut Simulation,
        world: &mut PhysicsWorld,
    ) -> Result<(), BridgeError> {
        let dt = tissue.world().resource::<StepClock>().dt;
        let rigid = world.integration_parameters.dt;
        if dt != rigid {
            return Err(BridgeError::Steps { tissue: dt, rigid });
        }
        let two_way = |link: &&Link| link.coupling == Coupling::TwoWay;
        let integrator = tissue.world().resource::<SolverSettings>().integrator;
        if integrator != Integrator::Newton && self.links.iter().flatten().any(|l| two_way(&l)) {
            return Err(BridgeError::Integrator(integrator.name()));
        }
        // all are looked at before one is moved
        let mut goals = Vec::new();
        for (number, link) in self.links.iter().enumerate() {
            let Some(link) = link else { continue };
            let Some(body) = world.bodies.get(link.rigid) else {
                return Err(BridgeError::Removed(link.name.clone(), link.rigid, number));
            };
            check_finite(&link.name, body)?;
            let goal = without_tissue(body, world.gravity, dt);
            // links of one body share what it can answer
            let of_body = self.links.iter().flatten().filter(two_way);
            let sharers = of_body.filter(|other| other.rigid == link.rigid).count();
            let compliance = 1.0 / link.stiffness + dt * dt * link.mobility * sharers as f64;
            goals.push((number, goal, goal * body.local_center_of_mass(), 1.0 / compliance));
        }
        for (number, goal, centre, stiffness) in goals {
            let Some(link) = &mut self.links[number] else { continue };
            link.centre = centre;
            link.aim(tissue, number, &goal, stiffness)?;
        }
        tissue.step()?;
        for (number, link) in self.links.iter_mut().enumerate() {
            if let Some(link) = link {
                link.feel(tissue, number)?;
            }
        }
        // rapier keeps forces until they are reset
        let mut own = Vec::new();
        for link in self.links.iter().flatten().filter(two_way) {
            if let Some(body) = world.bodies.get_mut(link.rigid) {
                own.push((link.rigid, body.user_force(), body.user_torque()));
                body.add_force(link.force, true);
                body.add_torque(link.torque, true);
                // one that sleeps loses its momentum
                body.wake_up(true);
            }
        }
        world.step();
        for (rigid, force, torque) in own.into_iter().rev() {
            if let Some(body) = world.bodies.get_mut(rigid) {
                body.reset_forces(false);
                body.reset_torques(false);
                body.add_force(force, false);
                body.add_torque(torque, false);
            }
        }
        Ok(())
    }
}

impl Link {
    /// Sends the tool or pull to where the rigid body would be.
    fn aim(
        &self,
        tissue: &mut Simulation,
        number: usize,
        goal: &RigidPose,
        stiffness: f64,
    ) -> Result<(), BridgeError> {
        let entity = tissue.current(self.entity);
        let mut found = tissue.world_mut().get_entity_mut(entity).ok();
        let released = || BridgeError::Released(self.name.clone(), number);
        let Some((rest, rest_centre)) = self.rest else {
            let mut tool = found.as_mut().and_then(|e| e.get_mut::<Tool>()).ok_or_else(released)?;
            if self.coupling == Coupling::TwoWay {
                tool.stiffness = Stiffness::Absolute(stiffness);
            }
            return Ok(tool.set_target(tool_pose(goal))?);
        };
        let mut pull = found.as_mut().and_then(|e| e.get_mut::<Pull>()).ok_or_else(released)?;
        let rotation = (goal.rotation * rest.rotation.inverse()).normalize();
        pull.stiffness = stiffness;
        pull.target =
            Pose { translation: self.centre - rest_centre, rotation, centre: rest_centre };
        Ok(())
    }

    /// Takes the wrench of the last step.
    fn feel(&mut self, tissue: &Simulation, number: usize) -> Result<(), BridgeError> {
        let tool: Option<&ToolReport> = tissue.tool_report(self.entity);
        let pull: Option<&PullReport> = tissue.pull_report(self.entity);
        (self.force, self.torque) = match (tool, pull) {
            (Some(felt), _) => {
                (felt.force, felt.torque + (felt.position - self.centre).cross(felt.force))
            }
            (_, Some(felt)) => (felt.force, felt.torque),
            _ => return Err(BridgeError::Released(self.name.clone(), number)),
        };
        let report = tissue.report();
        let contact = &report.contact;
        self.balanced = !(report.unconverged || contact.missed)
            && contact.substeps <= 1
            && contact.impacts == 0
            && contact.lagging == 0;
        Ok(())
    }
}

fn check_finite(name: &str, body: &RigidBody) -> Result<(), BridgeError> {
    let of = |pose: &RigidPose| pose.translation.is_finite() && pose.rotation.is_finite();
    let what = if !(of(body.position()) && of(body.next_position())) {
        "pose"
    } else if !(body.linvel().is_finite() && body.angvel().is_finite()) {
        "velocity"
    } else if !(body.user_force().is_finite() && body.user_torque().is_finite()) {
        "force"
    } else {
        return Ok(());
    };
    Err(BridgeError::NotFinite(name.into(), what))
}

/// Where a rigid body will be at the end of a step of `dt` if it touches no tissue.
fn without_tissue(body: &RigidBody, gravity: DVec3, dt: f64) -> RigidPose {
    if body.body_type() == RigidBodyType::KinematicPositionBased {
        return *body.next_position();
    }
    let mass = body.mass_properties();
    let force = body.user_force() + body.mass() * body.gravity_scale() * gravity;
    let turn = mass.effective_world_inv_inertia * body.user_torque();
    let slower = |damping: f64| if body.is_dynamic() { 1.0 / (1.0 + dt * damping) } else { 1.0 };
    let velocity = RigidBodyVelocity {
        linvel: (body.linvel() + dt * mass.effective_inv_mass * force)
            * slower(body.linear_damping()),
        angvel: (body.angvel() + dt * turn) * slower(body.angular_damping()),
    };
    velocity.integrate(dt, body.position(), &body.local_center_of_mass())
}

fn tool_pose(pose: &RigidPose) -> ToolPose {
    ToolPose { position: pose.translation, rotation: pose.rotation, opening: 0.0 }
}

/// Mobility of a tool (m^2/kg): of the boxes round its parts the three sides that are farther from the centre of mass, with contact
/// all over. Contact from both sides at once is not reckoned with.
fn tool_mobility(tool: &Tool, body: &RigidBody) -> Result<f64, BridgeError> {
    let whole = tool.parts.iter().all(|part| part.is_bounded());
    if tool.parts.is_empty() || !whole || tool.edge.is_some() || tool.needle.is_some() {
        return Err(BridgeError::Unbounded(tool.name.clone()));
    }
    let turn: DQuat = body.position().rotation;
    let sticks = tool.friction > 0.0 || tool.grip;
    let mut points = Vec::new();
    for part in &tool.parts {
        let [low, high] = part.bounds(part.at, part.rotation);
        let half = 0.5 * (high - low);
        let middle = 0.5 * (low + high) - body.local_center_of_mass();
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut out = DVec3::ZERO;
            out[axis] = if middle[axis] < 0.0 { -1.0 } else { 1.0 };
            let n = Vector3::from((turn * out).to_array());
            let block = if sticks { Matrix3::identity() } else { n * n.transpose() };
            // four points, each with a quarter of the side, have the moments of the whole side
            let at = 1.0 / 3.0_f64.sqrt();
            for (a, b) in [(-at, -at), (-at, at), (at, -at), (at, at)] {
                (out[u], out[v]) = (a, b);
                points.push((turn * (middle + half * out), block * (half[u] * half[v])));
            }
        }
    }
    Ok(mobility(body, points.into_iter()))
}

/// Largest eigenvalue of `M^-1/2 J^T D J M^-1/2`, by places (m) from the centre of mass and their blocks of `D`.
fn mobility(body: &RigidBody, points: impl Iterator<Item = (DVec3, Matrix3<f64>)>) -> f64 {
    let mass = body.mass_properties();
    let mut inverse = Matrix6::zeros();
    for (axis, unit) in DVec3::AXES.into_iter().enumerate() {
        inverse[(axis, axis)] = mass.effective_inv_mass[axis];
        let turn = Vector3::from((mass.effective_world_inv_inertia * unit).to_array());
        inverse.fixed_view_mut::<3, 1>(3, 3 + axis).copy_from(&turn);
    }
    let mut stiffness = Matrix6::zeros();
    for (at, block) in points {
        let mut jacobian = Matrix3x6::identity();
        let arm = Vector3::from(at.to_array()).cross_matrix();
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&-arm);
        stiffness += jacobian.transpose() * block * jacobian;
    }
    let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(inverse);
    let root = Matrix6::from_diagonal(&eigenvalues.map(|x| x.max(0.0).sqrt()));
    let root = eigenvectors * root * eigenvectors.transpose();
    (root * stiffness * root).symmetric_eigenvalues().max()
}
