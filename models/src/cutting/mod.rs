//! Cuts: a blade goes through bodies, at once, in their present shape.
//!
//! An element that the blade parts becomes several of the same shape, each with its share of the volume, that are moved by
//! vertices of their own where they come apart ([`Material`]). Volume enters energy, force, tangent and mass linearly, so
//! that neither of them changes at the instant of the cut, nor do kinetic energy and momentum; no element is smaller, flatter
//! or softer than before, and no state is interpolated.
//!
//! What can be cut: bodies of linear tetrahedra, with clusters of volume and with membranes on their faces; bodies of ten-node
//! tetrahedra with straight sides; bodies of hexahedra with full integration; all of these with axes, fibres and muscles; bodies that
//! are a membrane of triangles alone; membranes with fibres, too. Not membranes beside the faces of a body and those that bend, two
//! kinds of solid elements in one body, hexahedra that are filled in part, pooled springs and models of springs.
//!
//! - The vertices of the mesh stay where they are and mean what they meant: constraints, loads, pulls and lists of positions
//!   have the material that held them. The vertices that copies got are *ghosts*: nothing holds or loads them but the weight
//!   of their material. They have rows that the body was given when it was built ([`BodyDescription::spare`]).
//! - Copies are numbered after all tetrahedra of the mesh, in the order in which they came. A removal takes the material that
//!   has the number that it names; regions hold a copy where its own material is.
//! - Chips of less than 1e-8 of an element are parted, but get no copies: the largest rest of their element moves them.
//! - A blade that ends inside leaves elements at its end that it has entered: they are parted to their far side if it crossed
//!   one of their edges. So the mechanical cut may be up to an element longer than the blade, or shorter.
//! - A body at its rest shape does not gape when it is cut: what opens wounds is tension, from loads, muscles or a shape at
//!   rest that the scene does not let it have.
//!
//! - Axes, fibres and muscles go with the volume, or area, too. Where volume is kept by clusters, copies stay in the cluster of their
//!   element as long as material joins them; a cluster that falls apart becomes several, so that the sides of a wound have
//!   pressures of their own. In linear tetrahedra this is the one thing that changes the energy
//!   ([`CutReport::elastic_energy`]).
//! - Membranes and pressures on faces of linear tetrahedra go with the area of these: what is left of a face acts on the vertices that
//!   move it, by the first moments of its parts, which share its energy and mass out, too. Copies of membrane triangles are numbered
//!   after all of the mesh. No pressure acts on wounds. A membrane of nothing else comes apart in the same way, along lines.
//!   Its lips are touched by tools and other bodies, but not by each other where they are within two edges at rest.
//! - What is left of an element with Gauss points has points of its own, which integrate a uniform stress exactly, and in
//!   ten-node tetrahedra any polynomial of second degree. So elastic energy and forces change as far as strain differs within
//!   elements and the law is not linear, and in hexahedra by the terms of higher degree. Masses, kinetic energy and momentum
//!   do not.
//! - A wound through distorted hexahedra is plane in their local coordinates between marks that lie on the blade.
//!
//! [`BodyDescription::spare`]: crate::body::BodyDescription::spare

mod axes;
pub mod blade;
mod columns;
pub mod faces;
mod fine;
pub mod glue;
pub mod held;
mod hexahedra;
pub mod material;
pub mod quadrature;
mod skin;
pub mod stroke;
pub mod tear;
pub mod ten_node;

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::Serialize;
use sinew_engine::columns::{can_move_rows, single_table};
use sinew_engine::compiled_here;
use sinew_engine::connectivity::{ByKind, Connectivity, ElementKind};
use sinew_engine::isoparametric::MIDDLES;
use sinew_engine::law::partition_laws;
use sinew_engine::layout::{Lumps, WHOLE_TRIANGLE, lowest_first, starts};
use sinew_engine::load::Pressure;
use sinew_engine::resource::{ensure, put, take};
use sinew_engine::row::{LocalRow, MeshVertex, VertexRow};
use sinew_engine::scalar::Scalar;
use sinew_engine::stopwatch::Stopwatch;
use sinew_engine::surface::SurfacePoint;
use sinew_engine::topology::{BodyRows, ElementTables, Topology};
use sinew_engine::vertex::{
    Displacement, Mass, Position, RecentCut, RecentCuts, RestPosition, Velocity, WeightShift,
};
use sinew_identify::mass::MassLumping;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use self::columns::{Changed, points_of};
use self::faces::Sheet;
pub use self::fine::{FineSurface, carries_surface, carry_surface, drop_surface};
use self::material::{Element, Material, Order};
pub use self::skin::{
    MaterialSkin, cut_material, is_cut, node_places, node_velocities, update_skin,
};
use self::stroke::Stroke;
use crate::body::description::{MassRule, SoftBody};
use crate::body::edit_log::{Edit, before_edit, log_edit};
use crate::body::matter::{Chosen, Items, chosen};
use crate::body::present::{BodyResection, Resection};
use crate::body::sheet::MembraneModel;
use crate::frame::rules::{Evaluation, Integration};
use crate::laws::models::Model;
use crate::laws::{bending, pressure};
use crate::resection::{RemovalError, prepare_removals, renumber_blocks};

/// What a cut did.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CutReport {
    /// Elements that it parted, by their numbers, ascending.
    pub separated: Vec<u32>,
    /// Number of every copy that came to be, and of the element of the mesh that it is of.
    pub copies: Vec<[u32; 2]>,
    /// Vertices that it made.
    pub vertices: usize,
    /// Vertices that further cuts may make.
    pub spare: usize,
    /// Connected pieces of the body now; what glue holds together is one.
    pub pieces: usize,
    /// Least share of an element of the body now; of hexahedra in local coordinates.
    pub least_share: f64,
    /// Area (m^2, at rest) of one side of the wound; of a membrane its length times the thickness.
    pub area: f64,
    /// Elastic energy (J) that the body has more than before because clusters of volume fell apart; 0 without.
    pub elastic_energy: f64,
    /// Duration.
    pub time: Duration,
}

/// A cut that cannot be carried out; nothing has changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CutError {
    /// The surface of the blade cannot be used.
    #[error("the strip of the cut {problem}")]
    Strip {
        /// What is wrong with it, and what it must be.
        problem: String,
    },
    /// The body cannot be cut.
    #[error("body `{body}` cannot be cut: {problem}")]
    Body {
        /// Name of the body.
        body: String,
        /// Why, and what helps.
        problem: String,
    },
    /// The body cannot tear.
    #[error("body `{body}` cannot tear: {problem}")]
    Tear {
        /// Name of the body.
        body: String,
        /// Why, and what helps.
        problem: String,
    },
    /// It has too few vertices to spare.
    #[error(
        "the cut of body `{body}` needs {needed} more vertices and {left} are spare: build it with a larger `spare`"
    )]
    Spare {
        /// Name of the body.
        body: String,
        /// Vertices that the cut would make.
        needed: usize,
        /// Vertices left.
        left: usize,
    },
    /// No such body, or its tables were changed from outside.
    #[error(transparent)]
    Rows(#[from] RemovalError),
}

/// Cuts a body along the surface that a blade sweeps: its edge is at `[p, q]` (m), one position after another, in the
/// present shape of the body; between two of them lie the triangles `(p0, q0, p1)` and `(q0, q1, p1)`.
///
/// # Errors
/// When strip or body cannot be used; nothing is changed then. A blade that parts nothing is no error.
pub fn cut_body<S: Scalar>(
    world: &mut World,
    body: usize,
    strip: &[[DVec3; 2]],
) -> Result<CutReport, CutError> {
    compiled_here!(S, cut(world: &mut World, body: usize, strip: &[[DVec3; 2]]) -> Result<CutReport, CutError>)
}

fn cut<S: Scalar>(
    world: &mut World,
    body: usize,
    strip: &[[DVec3; 2]],
) -> Result<CutReport, CutError> {
    let problem = |problem: &str| Err(CutError::Strip { problem: problem.into() });
    if strip.len() < 2 {
        return problem("needs two positions of the blade at least");
    }
    if !strip.iter().flatten().all(|x| x.is_finite()) {
        return problem("has a number that is not finite");
    }
    if strip.iter().all(|[p, q]| p == q) {
        return problem("has no width: the ends of the blade must be two points");
    }
    let start = Stopwatch::start();
    let mut resection = prepared(world, body)?;
    let result: Result<_, CutError> = (|| {
        let own = resection.bodies[body].as_ref().expect("it was prepared");
        let material = material_of(world, body, own);
        let at = places::<S>(world, body);
        let (_, stroke) = material.stroke(strip, &|node| at[node as usize]);
        let mut report = open::<S>(world, body, &mut resection, (material, &stroke))?;
        report.time = start.elapsed();
        Ok(report)
    })();
    put(world, resection);
    let mut report = result?;
    glue::cross::<S>(world, body, strip);
    report.pieces = world.resource::<Topology>().bodies[body].piece_count();
    Ok(report)
}

/// Does a cut again.
pub(crate) fn open_again<S: Scalar>(
    world: &mut World,
    body: usize,
    stroke: &Stroke,
) -> Result<(), CutError> {
    let mut resection = prepared(world, body)?;
    let own = resection.bodies[body].as_ref().expect("it was prepared");
    let material = material_of(world, body, own);
    let (points, cells) = match (&material.uncut, stroke.goes_on) {
        (Some(uncut), true) => (uncut.points, uncut.cells.len() as u32),
        (None, true) => (0, 0),
        (_, false) => (material.points.len() as u32, material.cells.len() as u32),
    };
    let known = stroke.marks.iter().flat_map(|mark| mark.edge).all(|point| point < points)
        && stroke.marks.iter().all(|mark| mark.at > 0.0 && mark.at < 1.0)
        && stroke.separated.iter().all(|&cell| cell < cells);
    let result = if known {
        open::<S>(world, body, &mut resection, (material, stroke)).map(|_| ())
    } else {
        let problem = "the cut is of another mesh".into();
        Err(CutError::Strip { problem })
    };
    put(world, resection);
    result
}

/// Opens a body by what a stroke through its material as it is decided.
fn open_now<S: Scalar>(
    world: &mut World,
    body: usize,
    stroke: &Stroke,
) -> Result<CutReport, CutError> {
    let mut resection = prepared(world, body)?;
    let own = resection.bodies[body].as_ref().expect("it was prepared");
    let material = material_of(world, body, own);
    let opened = open::<S>(world, body, &mut resection, (material, stroke));
    put(world, resection);
    opened
}

/// What is kept for removals from a body, taken out of the world, once it is certain that the body can be cut.
fn prepared(world: &mut World, body: usize) -> Result<Resection, CutError> {
    check_cut(world, body)?;
    prepare_removals(world, body)?;
    Ok(take::<Resection>(world))
}

/// Whether a body can be cut.
///
/// # Errors
/// Says why not, and what helps.
pub fn check_cut(world: &mut World, body: usize) -> Result<(), CutError> {
    let count = world.resource::<Topology>().bodies.len();
    if body >= count {
        return Err(RemovalError::Body { index: body, count }.into());
    }
    let rows = &world.resource::<Topology>().bodies[body];
    let name = rows.name.clone();
    let used = ElementKind::ALL.into_iter().filter(|&kind| !rows.order[kind].is_empty());
    let (kinds, order) = (used.collect::<Vec<_>>(), order_of(rows));
    let is_spare = rows.spare > 0;
    if world.get_resource::<ElementTables>().is_some_and(|own| *own != ElementTables::of(world)) {
        return Err(RemovalError::LayoutChanged { body: name }.into());
    }
    let soft = soft_of(world, body);
    let of_sheet = soft.as_ref().and_then(|soft| sheet_problem(&kinds, order, soft));
    let problem = match &soft {
        None => "it has no elements",
        Some(_) if of_sheet.is_some() => of_sheet.unwrap_or_default(),
        Some(_) if kinds.iter().filter(|kind| kind.is_solid()).count() > 1 => {
            "tetrahedra and hexahedra in one body share no material; build a body of each, or remove elements"
        }
        Some(soft) if order != Order::Triangles && soft.evaluation == Evaluation::Pooled => {
            "pooled springs have no share of a volume; take evaluation = \"fused\""
        }
        Some(soft) if order != Order::Triangles && !scales(soft.model) => {
            "its model is not proportional to a volume; take one that is, \"svk_comp\" or another"
        }
        Some(soft) if soft.masses == MassRule::Equal => {
            "equal masses have no share of a volume; take masses = \"volume\""
        }
        Some(soft) if order == Order::Hexahedra && soft.integration == Integration::Reduced => {
            "the modes of reduced hexahedra have no share of a volume; take integration = \"full\""
        }
        Some(soft) if order == Order::Hexahedra && soft.masses.lumping() != MassLumping::RowSum => {
            "masses at corners have no share of a volume; take masses = \"volume\""
        }
        Some(soft) if soft.field().filled.is_some() => {
            "hexahedra that are filled in part have no share of a volume; take tetrahedra, or remove elements"
        }
        Some(_) if order == Order::TenNodes && is_curved(world, body) => {
            "ten-node tetrahedra with curved sides have no share of a volume; put vertices into the middles of edges"
        }
        _ if !is_spare => {
            "it has no vertices to spare; build it with `spare`, such as the number of vertices of the mesh"
        }
        _ if kinds.contains(&ElementKind::Triangle)
            && order != Order::Triangles
            && !bears_membrane(world, body)? =>
        {
            FREE_SHEETS
        }
        _ => return Ok(()),
    };
    Err(CutError::Body { body: name, problem: problem.into() })
}

/// A membrane that no cut can part.
const FREE_SHEETS: &str = "triangles of its membrane lie on no face of its tetrahedra; remove them, or build it without them";

/// Why the membrane of a body cannot be cut, if its faces can.
fn sheet_problem(kinds: &[ElementKind], order: Order, soft: &SoftBody) -> Option<&'static str> {
    let sheet = soft.membrane.as_ref();
    Some(match () {
        () if kinds.iter().all(|kind| kind.is_solid()) => return None,
        () if !kinds.iter().any(|kind| kind.is_solid()) && kinds.contains(&ElementKind::Quad) => {
            "quadrilaterals of its membrane have no share of an area; take triangles"
        }
        () if !order.is_linear() || kinds.contains(&ElementKind::Quad) => {
            "only triangles on faces of linear tetrahedra come apart with these; take such elements, or no membrane"
        }
        () if sheet.is_some_and(|m| m.is_pooled() || m.model == MembraneModel::MassSpring) => {
            "springs of its membrane have no share of an area; take evaluation = \"fused\" and model = \"trbs\" for it"
        }
        () if sheet.is_some_and(|m| m.bending.is_some()) => {
            "bending of its membrane has no share of an area; build that without bending"
        }
        () => return None,
    })
}

/// Whether all triangles of a membrane that are left lie on faces of tetrahedra that are.
fn bears_membrane(world: &mut World, body: usize) -> Result<bool, CutError> {
    prepare_removals(world, body)?;
    let known = world.get_resource::<Resection>().and_then(|own| own.connectivity(body));
    Ok(known.is_none_or(|own| {
        own.all_left(ElementKind::Triangle).all(|t| {
            let round = own.round_triangle.of(own.cells.triangles_of.triangles.of(t)[0]);
            own.left(ElementKind::Tetrahedron, round).next().is_some()
        })
    }))
}

/// How far (in edges) a vertex may lie from the middle of an edge that counts as straight.
const STRAIGHT: f64 = 1e-6;

/// Whether sides of ten-node tetrahedra are curved at rest.
fn is_curved(world: &mut World, body: usize) -> bool {
    let rest = rest_of(world, body);
    let rows = &world.resource::<Topology>().bodies[body];
    rows.tetrahedra10().iter().any(|nodes| {
        MIDDLES.iter().zip(&nodes[4..]).any(|(&[a, b], &middle)| {
            let [a, b, middle] = [nodes[a], nodes[b], middle].map(|row| rest[row as usize]);
            middle.distance(0.5 * (a + b)) > STRAIGHT * a.distance(b)
        })
    })
}

/// What a body is of.
fn soft_of(world: &mut World, body: usize) -> Option<SoftBody> {
    world.query::<&SoftBody>().iter(world).find(|soft| soft.index == body).cloned()
}

/// Whether the energy of a model is proportional to the columns of volumes: quadratic springs take lengths at rest from them.
fn scales(model: Model) -> bool {
    !matches!(model, Model::QuadraticSprings | Model::MassSpring | Model::Own(_))
}

/// What kind of elements a body has that can be cut.
fn order_of(rows: &BodyRows) -> Order {
    match () {
        () if !rows.tetrahedra10().is_empty() => Order::TenNodes,
        () if !rows.hexahedra().is_empty() => Order::Hexahedra,
        () if rows.tetrahedra().is_empty() && !rows.triangles().is_empty() => Order::Triangles,
        () => Order::Linear,
    }
}

fn kind_of(rows: &BodyRows) -> ElementKind {
    match order_of(rows) {
        Order::Hexahedra => ElementKind::Hexahedron,
        Order::Triangles => ElementKind::Triangle,
        Order::Linear | Order::TenNodes => ElementKind::Tetrahedron,
    }
}

/// Elements of a body that was not cut, by vertices of the mesh.
fn in_mesh<const N: usize>(rows: &BodyRows, kind: ElementKind) -> Vec<[u32; N]> {
    let of_rows = rows.nodes[kind].each::<N>();
    let mut all = vec![[0; N]; of_rows.len()];
    for (nodes, &index) in of_rows.iter().zip(&rows.order[kind]) {
        all[index as usize] = nodes.map(|v| rows.vertex_order[LocalRow(v)].0);
    }
    all
}

/// The material of a body as it is now.
fn material_of(world: &World, body: usize, own: &BodyResection) -> Arc<Material> {
    let rows = &world.resource::<Topology>().bodies[body];
    let kind = kind_of(rows);
    let is_left = |e: u32| own.connectivity.is_present(kind, own.element_of[kind][e as usize]);
    let mut material = match &own.material {
        Some(material) => material.clone(),
        None => {
            let vertices = rows.mesh_vertices();
            let mut material = match order_of(rows) {
                Order::Linear => Material::new(vertices, &in_mesh(rows, kind)),
                Order::TenNodes => Material::of_ten_nodes(vertices, &in_mesh(rows, kind)),
                Order::Hexahedra => Material::of_hexahedra(vertices, &in_mesh(rows, kind)),
                Order::Triangles => Material::of_triangles(vertices, &in_mesh(rows, kind)),
            };
            if material.order != Order::Triangles {
                let triangles = in_mesh::<3>(rows, ElementKind::Triangle).into_iter();
                material.sheets = (0..).zip(triangles).map(Sheet::whole).collect();
            }
            Arc::new(material)
        }
    };
    let of_sheets = own.element_of[ElementKind::Triangle].iter();
    let gone = of_sheets.map(|&row| !own.connectivity.is_present(ElementKind::Triangle, row));
    let same_sheets = gone.clone().zip(&material.sheets).all(|(gone, own)| own.is_gone == gone);
    // all that is left whole is shared
    if !(same_sheets && material.cells.iter().all(|cell| is_left(cell.element))) {
        let material = Arc::make_mut(&mut material);
        material.keep(is_left);
        material.sheets.iter_mut().zip(gone).for_each(|(sheet, gone)| sheet.is_gone = gone);
    }
    material
}

/// Row of a vertex of the mesh or a ghost, as the material numbers them.
fn row_of(rows: &BodyRows, node: u32) -> u32 {
    match (node as usize).checked_sub(rows.mesh_vertices()) {
        Some(ghost) => (rows.vertex_order.len() + ghost) as u32,
        None => rows.row_of_vertex[MeshVertex(node)].map_or(0, |row| row.0),
    }
}

/// Places (m) of the vertices of the mesh and the ghosts of a body.
fn places<S: Scalar>(world: &mut World, body: usize) -> Vec<DVec3> {
    let mut query = world.query::<(&RestPosition, &Displacement<S>)>();
    let rows = &world.resource::<Topology>().bodies[body];
    let Some((rest, u)) = single_table(query.contiguous_iter(world)) else { return Vec::new() };
    let nodes = 0..(rows.mesh_vertices() + rows.copies.ghosts.len()) as u32;
    let at = |node| (rows.vertices.start + row_of(rows, node)) as usize;
    nodes.map(|node| rest[at(node)].0 + u[at(node)].get()).collect()
}

/// Divides a body by what a stroke decided.
fn open<S: Scalar>(
    world: &mut World,
    body: usize,
    resection: &mut Resection,
    (before, stroke): (Arc<Material>, &Stroke),
) -> Result<CutReport, CutError> {
    let own = resection.bodies[body].as_ref().expect("it was prepared");
    let old = world.resource::<Topology>().bodies[body].clone();
    let kind = kind_of(&old);
    let mut material = (*before).clone();
    if !material.bears_sheets() {
        return Err(CutError::Body { body: old.name.clone(), problem: FREE_SHEETS.into() });
    }
    let rest = rest_of(world, body);
    let at_rest = |vertex: u32| rest[row_of(&old, vertex) as usize];
    let area = material.wound_area(&at_rest);
    let soft = soft_of(world, body);
    let thickness = match (material.order, &soft) {
        (Order::Triangles, Some(soft)) => soft.membrane.map_or(0.0, |own| own.thickness),
        _ => 1.0,
    };
    let mut origins = Vec::new();
    if !stroke.separated.is_empty() {
        let gluing = soft.as_ref().and_then(|soft| glue::gluing(soft, &at_rest));
        let gluing = gluing.as_ref().map(|own| own as material::Gluing);
        origins = material.open_glued(stroke, gluing);
    }
    let changed: Vec<u32> = (0..material.elements.len())
        .filter(|&e| before.elements.get(e) != Some(&material.elements[e]))
        .map(|e| e as u32)
        .collect();
    // also neighbours whose vertices are others now
    let is_parted = |e: &u32| {
        let was = before.elements.get(*e as usize);
        was.is_some_and(|was| was.portion != material.elements[*e as usize].portion)
    };
    let copies = before.elements.len()..material.elements.len();
    let mut report = CutReport {
        separated: changed.iter().copied().filter(is_parted).collect(),
        copies: copies.map(|e| [e as u32, material.elements[e].source]).collect(),
        vertices: origins.len(),
        spare: old.spare - old.copies.ghosts.len(),
        pieces: own.pieces,
        least_share: material.elements.iter().map(Element::share).fold(1.0, f64::min),
        area: thickness * (material.wound_area(&at_rest) - area),
        ..CutReport::default()
    };
    if changed.is_empty() {
        return Ok(report);
    }
    let name = || old.name.clone();
    let Some(left) = report.spare.checked_sub(origins.len()) else {
        let (needed, left) = (origins.len(), report.spare);
        return Err(CutError::Spare { body: name(), needed, left });
    };
    report.spare = left;
    if !material.order.is_linear() {
        check_faces(world, &old, own, &changed)?;
    }
    let sheets = changed_sheets(&before.sheets, &material);
    let parted: Vec<u32> =
        report.separated.iter().map(|&e| own.element_of[kind][e as usize]).collect();
    let can_copy = |(kind, e): (ElementKind, u32)| {
        let element = own.rows.elements[kind][e as usize];
        own.rows.axes(kind, e).chain([element]).all(|entity| can_move_rows(world, entity))
    };
    let of_sheets = sheets.iter().filter_map(|&t| {
        let row = own.element_of[ElementKind::Triangle].get(t as usize)?;
        Some((ElementKind::Triangle, *row))
    });
    if !parted.iter().map(|&e| (kind, e)).chain(of_sheets).all(can_copy) {
        let problem = "a component of its elements owns something and has no copy; keep such data on entities of your own";
        return Err(CutError::Body { body: name(), problem: problem.into() });
    }
    // the image of what was before holds what is kept for removals, too
    put(world, std::mem::take(resection));
    before_edit::<S>(world);
    *resection = take(world);
    log_edit(world, Edit::Cut { body, stroke: stroke.clone() });
    let parting = Parting { old, before, material, origins, changed, sheets, parted };
    (report.pieces, report.elastic_energy) = divide::<S>(world, body, resection, parting);
    Ok(report)
}

/// What becomes of the elements of a body.
struct Parting {
    /// Rows of the body as they were.
    old: BodyRows,
    /// They as they were.
    before: Arc<Material>,
    /// And as they are to be.
    material: Material,
    /// For every new ghost the vertex or ghost in whose place it comes.
    origins: Vec<u32>,
    /// Numbers of those that are others now, ascending.
    changed: Vec<u32>,
    /// The same of membrane triangles.
    sheets: Vec<u32>,
    /// Rows of those that were parted.
    parted: Vec<u32>,
}

/// Divides elements and their columns. The number of pieces of the body, and the elastic energy (J) that it has more.
fn divide<S: Scalar>(
    world: &mut World,
    body: usize,
    resection: &mut Resection,
    Parting { old, before, material, origins, changed, sheets, parted }: Parting,
) -> (usize, f64) {
    let own = resection.bodies[body].as_mut().expect("it was prepared");
    let (kind, rest) = (kind_of(&old), rest_of(world, body));
    let soft = soft_of(world, body);
    let losing = soft.as_ref().map(|soft| own.parting::<S>(world, soft, &parted));
    let mut new = parted_rows(&old, own, &material, [&changed, &sheets]);
    let copies = copy_vertices::<S>(world, &new, &origins);
    let points = points_of(&material, &changed, &|vertex| rest[row_of(&old, vertex) as usize]);
    let element_of = new.rows_of(kind);
    for (e, (_, lumps)) in &points {
        new.ordered.copies.lumps.resize(material.elements.len(), Lumps::default());
        new.ordered.copies.lumps[element_of[*e as usize] as usize] = *lumps;
    }
    let of_sheets = new.rows_of(ElementKind::Triangle);
    let mut rows = ByKind::<Vec<u32>>::default();
    rows[ElementKind::Triangle] = sheets.iter().map(|&t| of_sheets[t as usize]).collect();
    rows[kind] = changed.iter().map(|&e| element_of[e as usize]).collect();
    // whose elements are its sheets
    let changed = if material.order == Order::Triangles { Vec::new() } else { changed };
    let mut connectivity = own.connectivity.after(&new, &rows);
    let gone = chosen(&old, |kind, e| !own.connectivity.is_present(kind, e));
    connectivity.remove(&gone);
    let was = std::mem::replace(&mut own.connectivity, connectivity);
    let masses = soft.as_ref().map(|soft| {
        sum_masses::<S>(world, (body, soft), (&old, &was), (&new, &own.connectivity), &rows)
    });
    let cut = RecentCut { body, copies, masses: masses.unwrap_or_default() };
    ensure::<RecentCuts<S>>(world).0.push(cut);
    own.element_of[kind] = element_of;
    own.element_of[ElementKind::Triangle] = of_sheets;
    let pieces = glue::pieces(world, (body, &new), own, &material);
    new.set_pieces(pieces);
    new.changes += 1;
    own.pieces = new.piece_count();
    let glued = own.glued_pairs(&material, &new);
    merge_edges(world, body, new.clone(), (&own.connectivity, &glued));
    let elements = (&before.elements[..], &material);
    let rest = &rest_of(world, body);
    let (rows, numbers) = (&new, &changed[..]);
    let sheets = (&before.sheets[..], &sheets[..], soft.as_ref().and_then(|soft| soft.membrane));
    columns::write::<S>(world, Changed { rows, own, elements, numbers, sheets, points, rest });
    own.material = Some(Arc::new(material));
    partition_laws::<S>(world);
    let tables = ElementTables::of(world);
    world.insert_resource(tables);
    resection.find_rows(world);
    let own = resection.bodies[body].as_ref().expect("it was prepared");
    let energy = match (&soft, losing) {
        (Some(soft), Some(losing)) => -own.settle_clusters::<S>(world, soft, losing),
        _ => 0.0,
    };
    let pieces = own.pieces;
    bending::refresh::<S>(world, Some(resection));
    pressure::refresh::<S>(world, Some(resection));
    glue::refresh::<S>(world, Some(resection));
    (pieces, energy)
}

/// Divides a body that is whole as another one like it has been divided, which is of this material now.
pub(crate) fn divide_alike<S: Scalar>(world: &mut World, body: usize, material: &Material) {
    let Ok(mut resection) = prepared(world, body) else { return };
    let own = resection.bodies[body].as_ref().expect("it was prepared");
    let before = material_of(world, body, own);
    let sheets = changed_sheets(&before.sheets, material);
    let is_other = |e: &usize| before.elements.get(*e) != Some(&material.elements[*e]);
    let changed = (0..material.elements.len()).filter(is_other).map(|e| e as u32).collect();
    let (origins, mut material) = (material.ghosts.clone(), material.clone());
    // here all copies fall off whole elements
    material.elements.iter_mut().for_each(|element| element.parent = element.source);
    material.sheets.iter_mut().for_each(|sheet| sheet.parent = sheet.source);
    let (old, parted) = (world.resource::<Topology>().bodies[body].clone(), Vec::new());
    let parting = Parting { old, before, material, origins, changed, sheets, parted };
    divide::<S>(world, body, &mut resection, parting);
    put(world, resection);
}

/// Rest positions (m) of all rows of a body.
fn rest_of(world: &mut World, body: usize) -> Vec<DVec3> {
    let mut query = world.query::<&RestPosition>();
    let rows = &world.resource::<Topology>().bodies[body];
    let own = rows.vertices.start as usize..rows.vertices.end as usize;
    let all = single_table(query.contiguous_iter(world)).unwrap_or(&[]);
    all.get(own).unwrap_or(&[]).iter().map(|x| x.0).collect()
}

/// Refuses a pressure on faces of elements with Gauss points that come apart.
fn check_faces(
    world: &mut World,
    rows: &BodyRows,
    own: &BodyResection,
    changed: &[u32],
) -> Result<(), CutError> {
    let kind = kind_of(rows);
    let known = changed.iter().filter_map(|&e| own.element_of[kind].get(e as usize));
    let elements: Vec<&[u32]> = known.map(|&e| rows.nodes[kind].of(e)).collect();
    for pressure in world.query::<&Pressure>().iter(world) {
        let on = |face: &[VertexRow; 3]| {
            let local = face.map(|row| rows.local(row).map(|row| row.0));
            let has = |t: &&[u32]| local.iter().all(|v| v.is_some_and(|v| t.contains(&v)));
            elements.iter().any(has)
        };
        if pressure.faces.iter().any(on) {
            let problem = format!(
                "pressure `{}` acts on faces that the blade parts; take it away, or give it other faces",
                pressure.name
            );
            return Err(CutError::Body { body: rows.name.clone(), problem });
        }
    }
    Ok(())
}

/// The rows of a body after a cut: elements keep theirs, copies follow all others.
fn parted_rows(
    old: &BodyRows,
    own: &BodyResection,
    material: &Material,
    [changed, sheets]: [&[u32]; 2],
) -> BodyRows {
    let mut new = old.clone();
    parted_sheets(&mut new, (old, own), (material, sheets));
    let copies = &mut new.ordered.copies;
    copies.kind = kind_of(old);
    copies.ghosts = material.ghosts.iter().map(|&vertex| row_of(old, vertex)).collect();
    copies.portions.resize(material.elements.len(), [0.25; 4]);
    match material.order {
        Order::Linear => parted_nodes::<4>(&mut new, (old, own), (material, changed), lowest_first),
        Order::TenNodes => parted_nodes::<10>(&mut new, (old, own), (material, changed), |t| t),
        Order::Hexahedra => parted_nodes::<8>(&mut new, (old, own), (material, changed), |h| h),
        Order::Triangles => {}
    }
    new
}

/// The same for elements of `N` vertices, which `turn` brings into their order.
fn parted_nodes<const N: usize>(
    new: &mut BodyRows,
    (old, own): (&BodyRows, &BodyResection),
    (material, changed): (&Material, &[u32]),
    turn: fn([u32; N]) -> [u32; N],
) {
    let kind = new.copies.kind;
    let mut nodes = old.nodes[kind].each::<N>().to_vec();
    for &e in changed {
        let element = &material.elements[e as usize];
        let rows: [u32; N] = std::array::from_fn(|i| row_of(old, element.node(i)));
        let turned = turn(rows);
        let known = own.element_of[kind].get(e as usize);
        let at = known.map_or(nodes.len(), |&row| row as usize);
        if known.is_none() {
            nodes.push(turned);
            new.ordered.order[kind].push(e);
            new.ordered.copies.sources.push(element.source);
        }
        nodes[at] = turned;
        let place = |row| rows.iter().position(|&own| own == row).unwrap_or(0);
        // corners come first
        new.ordered.copies.portions[at] =
            [0, 1, 2, 3].map(|i| element.portion[place(turned[i]).min(3)]);
    }
    new.ordered.nodes[kind] = nodes.into();
}

/// The same for membrane triangles, whose rows ascend.
fn parted_sheets(
    new: &mut BodyRows,
    (old, own): (&BodyRows, &BodyResection),
    (material, changed): (&Material, &[u32]),
) {
    let kind = ElementKind::Triangle;
    let mut nodes = old.triangles().to_vec();
    new.ordered.copies.sheet_portions.resize(material.sheets.len(), WHOLE_TRIANGLE);
    for &t in changed {
        let sheet = &material.sheets[t as usize];
        let mut own_rows = [0, 1, 2].map(|i| (row_of(old, sheet.nodes[i]), sheet.portion[i]));
        own_rows.sort_unstable_by_key(|(row, _)| *row);
        let known = own.element_of[kind].get(t as usize);
        let at = known.map_or(nodes.len(), |&row| row as usize);
        if known.is_none() {
            nodes.push([0; 3]);
            new.ordered.order[kind].push(t);
            new.ordered.copies.sheet_sources.push(sheet.source);
        }
        nodes[at] = own_rows.map(|(row, _)| row);
        new.ordered.copies.sheet_portions[at] = own_rows.map(|(_, part)| part);
    }
    new.ordered.nodes[kind] = nodes.into();
}

/// Numbers of membrane triangles that are others than before.
fn changed_sheets(before: &[Sheet], material: &Material) -> Vec<u32> {
    let all = (0..).zip(&material.sheets);
    let is_other = |(t, sheet): &(u32, &Sheet)| before.get(*t as usize) != Some(*sheet);
    all.filter(is_other).map(|(t, _)| t).collect()
}

/// Gives the last ghosts of a body the state of the vertices or ghosts in whose place they come; rows of each pair.
fn copy_vertices<S: Scalar>(world: &mut World, rows: &BodyRows, origins: &[u32]) -> Vec<[u32; 2]> {
    let first = rows.vertices.start as usize;
    let to = first + rows.vertex_order.len() + rows.copies.ghosts.len() - origins.len();
    type Columns<S> = (
        &'static mut RestPosition,
        &'static mut Position,
        &'static mut Displacement<S>,
        &'static mut Velocity<S>,
        &'static mut MeshVertex,
    );
    let mut query = world.query::<Columns<S>>();
    let Some((mut rest, mut x, mut u, mut v, mut vertex)) =
        single_table(query.contiguous_iter_mut(world))
    else {
        return Vec::new();
    };
    let copied = (to..).zip(origins).map(|(to, &origin)| {
        let from = first + row_of(rows, origin) as usize;
        (rest[to], x[to], u[to], v[to], vertex[to]) =
            (rest[from], x[from], u[from], v[from], vertex[from]);
        [to as u32, from as u32]
    });
    copied.collect()
}

/// Shares the masses out again where elements, by their rows, came apart: rows of masses that are others, with those before and
/// now (kg). What a removal left of removed elements stays where it is.
fn sum_masses<S: Scalar>(
    world: &mut World,
    (body, soft): (usize, &SoftBody),
    old: (&BodyRows, &Connectivity),
    new: (&BodyRows, &Connectivity),
    changed: &ByKind<Vec<u32>>,
) -> Vec<(u32, [S; 2])> {
    let rest = rest_of(world, body);
    let mut vertices = BTreeSet::new();
    let changed = ElementKind::ALL.map(|kind| changed[kind].iter().map(move |&e| (kind, e)));
    for (kind, e) in changed.into_iter().flatten() {
        // copies are of the new ones alone
        if (e as usize) < old.0.order[kind].len() {
            vertices.extend(old.0.nodes[kind].of(e));
        }
        vertices.extend(new.0.nodes[kind].of(e));
    }
    let vertices: Vec<u32> = vertices.into_iter().collect();
    let sums = [old, new].map(|(rows, connectivity)| {
        let mut left = Chosen::default();
        for kind in ElementKind::ALL {
            let round = vertices.iter().flat_map(|&v| connectivity.round_vertex[kind].of(v));
            let round = round.copied().filter(|&e| connectivity.is_present(kind, e));
            left[kind] = round.collect::<BTreeSet<u32>>().into_iter().collect();
        }
        let at_rest = |row: u32| rest[row as usize];
        let (matter, own) = (soft.matter(&rows.ordered, &at_rest), Items::Only(&vertices));
        [matter.masses(own, &left), matter.weight_shifts(own, &left)]
    });
    let first = new.0.vertices.start as usize;
    let mut query = world.query::<(&mut Mass<S>, &mut WeightShift<S>)>();
    let Some((mut mass, mut shift)) = single_table(query.contiguous_iter_mut(world)) else {
        return Vec::new();
    };
    let mut masses = Vec::new();
    let [was, now] = &sums;
    for (at, &row) in vertices.iter().enumerate() {
        let row = first + row as usize;
        let before = mass[row].0;
        let columns = [&mut mass[row].0, &mut shift[row].0];
        for (column, (was, now)) in columns.into_iter().zip(was.iter().zip(now)) {
            let kept = column.to_f64() - S::from_f64(was[at]).to_f64();
            if was[at] != now[at] {
                *column = S::from_f64(now[at] + kept);
            }
        }
        if mass[row].0 != before {
            masses.push((row as u32, [before, mass[row].0]));
        }
    }
    masses
}

/// Adds the edges of copies and the pairs that glue couples to the edge graph, and numbers the blocks of all elements anew.
fn merge_edges(
    world: &mut World,
    body: usize,
    new: BodyRows,
    (connectivity, glued): (&Connectivity, &[[u32; 2]]),
) {
    let mut topology = world.resource_mut::<Topology>();
    let topology = &mut *topology;
    let own = new.vertices.clone();
    let used = (0..).zip(&connectivity.cells.edges).filter(|(e, _)| connectivity.uses_edge(*e));
    let used: Vec<[u32; 2]> = used.map(|(_, edge)| edge.map(|v| v + own.start)).collect();
    let before = std::mem::take(&mut topology.edges);
    let mut edges: Vec<[u32; 2]> = before.iter().chain(&used).chain(glued).copied().collect();
    // runs that are ascending, which a stable sort merges
    edges.sort();
    edges.dedup();
    let mut unused = vec![false; edges.len()];
    let mut block = Vec::with_capacity(before.len());
    let (mut olds, mut news) = ((0..).zip(&before).peekable(), used.iter().peekable());
    for (place, edge) in edges.iter().enumerate() {
        let old = olds.next_if(|(_, own)| *own == edge);
        let is_used = news.next_if_eq(&edge).is_some();
        unused[place] = match own.contains(&edge[0]) {
            true => !is_used,
            false => old.is_some_and(|(at, _)| !topology.uses_edge(at)),
        };
        block.extend(old.map(|_| place as u32));
    }
    topology.bodies[body] = new;
    for rows in &mut topology.bodies {
        let [start, end] = [rows.vertices.start, rows.vertices.end]
            .map(|row| edges.partition_point(|edge| edge[0] < row) as u32);
        rows.blocks = start..end;
    }
    topology.edge_start = starts(topology.vertex_count(), edges.iter().map(|edge| edge[0]));
    topology.unused_edges = if unused.contains(&true) { unused } else { Vec::new() };
    topology.edges = edges;
    topology.revision += 1;
    renumber_blocks(world, &block);
}

/// What a body that was cut shows of its material where elements are not whole.
pub(crate) struct CutFaces {
    /// Points that cuts made, by their numbers in the material.
    pub points: Vec<SurfacePoint>,
    /// Triangles, outward: of rows of the body, and of points from the number of these rows on.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles up to here are wounds.
    pub wounds: usize,
    /// Kind of the elements whose outside this is; of a membrane alone the triangles are what is left of it.
    pub kind: ElementKind,
    /// Rows of those that it is of.
    pub divided: Vec<bool>,
}

/// What a body shows where its elements are not whole; `None` before it is cut.
pub(crate) fn cut_faces(world: &World, body: usize) -> Option<CutFaces> {
    let own = world.get_resource::<Resection>()?.bodies.get(body)?.as_ref()?;
    own.material.as_ref()?;
    let material = material_of(world, body, own);
    let rows = &world.resource::<Topology>().bodies[body];
    let first = rows.row_count() as u32;
    let kind = kind_of(rows);
    let row = |e: u32| own.element_of[kind][e as usize];
    let mut cells = vec![0_u32; material.elements.len()];
    material.cells.iter().for_each(|cell| cells[cell.element as usize] += 1);
    let mut divided = vec![false; cells.len()];
    for (e, cells) in (0..).zip(cells) {
        divided[row(e) as usize] =
            cells as usize > material.order.cells() || !rows.is_whole(kind, row(e));
    }
    let mut points = vec![SurfacePoint::default(); material.points.len() - rows.mesh_vertices()];
    let (mut triangles, mut wounds) = (Vec::new(), 0);
    let mut skin = material.skin_of(|cell| divided[row(cell.element) as usize]);
    skin.sort_by_key(|(_, _, wound)| !wound);
    for (face, cell, wound) in skin {
        let number = material.cells[cell as usize].element;
        let element = &material.elements[number as usize];
        let mut corner = |point: u32| match point.checked_sub(material.vertices) {
            // whoever holds a vertex is moved by it
            None => row_of(rows, point),
            Some(made) => {
                let mut own = SurfacePoint::default();
                let held = material.held_by(element, &material.points[point as usize]);
                for (k, (i, weight)) in held.enumerate() {
                    (own.rows[k], own.weights[k]) = (row_of(rows, element.node(i)), weight);
                }
                points[made as usize] = own;
                first + made
            }
        };
        let own = material.with_middles(face, number);
        wounds += if wound { own.len() } else { 0 };
        triangles.extend(own.into_iter().map(|face| face.map(&mut corner)));
    }
    Some(CutFaces { points, triangles, wounds, kind, divided })
}
