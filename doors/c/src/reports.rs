//! Structures of reports, and how they are filled. Written by test `lists` of sinew-embed; do not edit.

use sinew_embed::{DMat3, PartReport, ToolReport};

/// Forces on a tool and its contacts at the end of the last step.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_tool_report {
    /// sizeof(sinew_tool_report), set by the caller
    pub struct_size: u32,
    /// Number of its parts, if there are several.
    pub parts: u32,
    /// Where the tool was: place (m) of its origin.
    pub position: [f64; 3],
    /// Way (m) from where the hand would have it to there, of a tool on a spring.
    pub yields: [f64; 3],
    /// Its rotation.
    pub quaternion: [f64; 4],
    /// Its opening (rad).
    pub opening: f64,
    /// Velocity (m/s) of its origin.
    pub velocity: [f64; 3],
    /// Angular velocity (rad/s).
    pub angular_velocity: [f64; 3],
    /// Force (N) on the tool: normal, friction, of what it cuts, and of the thread that its needle draws.
    pub force: [f64; 3],
    /// Torque (N m) on the tool about its origin.
    pub torque: [f64; 3],
    /// Torque (N m) about the hinge with which tissue holds its jaws open: the energy per angle (rad) that closing them
    /// takes.
    pub closing: f64,
    /// The part of the force that pressure makes (N).
    pub normal: [f64; 3],
    /// The part of the force that friction makes (N).
    pub friction: [f64; 3],
    /// Work (J) done by the tool on bodies since it came, by the force at the end of every step. That on the thread of
    /// its needle is in the report of the thread.
    pub work: f64,
    /// Energy (J) that friction has taken since it came.
    pub dissipation: f64,
    /// Energy (J) stored in its contacts: penetration and sticking.
    pub energy: f64,
    /// Area (m^2, at rest) that touches it.
    pub area: f64,
    /// Largest penetration (m).
    pub depth: f64,
    /// Largest pressure (Pa).
    pub pressure: f64,
    /// Centre of pressure (m); its origin while nothing touches it.
    pub centre: [f64; 3],
    /// Points that touch it and stick.
    pub sticking: u32,
    /// Points that touch it and slip.
    pub slipping: u32,
    /// Distance (m) to its target, where its way was longer than the substeps of a step can follow.
    pub lag: f64,
    /// How far (m) the surfaces of its shapes are drawn in, because it appeared partly inside of a body; of a cavity
    /// how far they are widened, because it appeared with tissue outside. A tool wholly inside touches nothing, and is
    /// counted as buried.
    pub drawn_in: f64,
    /// A part of it went through the surface of a body, and touches nothing of that body until it is out.
    pub pierced: u32,
    /// Force (N) by points of the other kind at the same state, if `SINEW_ERROR_BAR` asks for it. It is no estimate of
    /// the error: these points have not pushed the tissue away, so it may be several times what they give in a run of
    /// their own. All 0 without.
    pub other_points: [f64; 3],
    /// Change of its force (N) per motion (m) of its pose at the end of the step, with the tissue moving along within
    /// the step, if `SINEW_LOCAL_STIFFNESS` asks for it of an implicit integrator: the force is about `force +
    /// local_stiffness * way`. Symmetric; limits of friction as they are. Exact for `newton`, to the tolerance of the
    /// linear solver. All 0 without.
    pub local_stiffness: [f64; 9],
    /// Whether the step that these forces are of did not converge: they are not to be relied on.
    pub unconverged: u32,
    /// Area (m^2, in the shapes of the steps) that its edge swept through tissue against its toughness since it came.
    pub cut_area: f64,
    /// Energy (J) that this took, or the tip of its needle.
    pub fracture: f64,
    /// Elements that its edge parted since it came.
    pub separated: u32,
    /// Vertices that this made.
    pub cut_vertices: u32,
    /// Length (m) of its needle in tissue.
    pub inserted: f64,
    /// Force (N) of the tissue on the tip of its needle, against the direction of the tip.
    pub tip_force: f64,
    /// Force (N) of the channel along the shaft, positive where it holds the needle back from going in.
    pub shaft_force: f64,
    /// Surfaces that gave way to its needle since it came.
    pub punctures: u32,
}

impl From<&ToolReport> for sinew_tool_report {
    fn from(r: &ToolReport) -> Self {
        Self {
            struct_size: size_of::<Self>() as u32,
            parts: r.parts.len() as u32,
            position: r.position.to_array(),
            yields: r.yields.to_array(),
            quaternion: r.rotation.to_array(),
            opening: r.opening,
            velocity: r.velocity.to_array(),
            angular_velocity: r.angular_velocity.to_array(),
            force: r.force.to_array(),
            torque: r.torque.to_array(),
            closing: r.closing,
            normal: r.normal.to_array(),
            friction: r.friction.to_array(),
            work: r.work,
            dissipation: r.dissipation,
            energy: r.energy,
            area: r.area,
            depth: r.depth,
            pressure: r.pressure,
            centre: r.centre.to_array(),
            sticking: r.sticking,
            slipping: r.slipping,
            lag: r.lag,
            drawn_in: r.drawn_in,
            pierced: r.pierced.into(),
            other_points: r.other_points.unwrap_or_default().to_array(),
            local_stiffness: r.local_stiffness.unwrap_or(DMat3::ZERO).to_cols_array(),
            unconverged: r.unconverged.into(),
            cut_area: r.cut_area,
            fracture: r.fracture,
            separated: r.separated,
            cut_vertices: r.cut_vertices,
            inserted: r.inserted,
            tip_force: r.tip_force,
            shaft_force: r.shaft_force,
            punctures: r.punctures,
        }
    }
}

/// Forces on one part of a tool, such as one of two jaws.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_part_report {
    /// Force (N) on it, normal and friction.
    pub force: [f64; 3],
    /// Torque (N m) on it about the tool's origin.
    pub torque: [f64; 3],
    /// Largest penetration (m).
    pub depth: f64,
    /// Points that touch it and stick.
    pub sticking: u32,
    /// Points that touch it and slip.
    pub slipping: u32,
}

impl From<&PartReport> for sinew_part_report {
    fn from(r: &PartReport) -> Self {
        Self {
            force: r.force.to_array(),
            torque: r.torque.to_array(),
            depth: r.depth,
            sticking: r.sticking,
            slipping: r.slipping,
        }
    }
}
