//! From a description to entities.

use bevy_ecs::bundle::NoBundleEffect;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::by_precision;
use sinew_engine::compression::report_compression;
use sinew_engine::connectivity::{ByKind, ElementKind, PerElement};
use sinew_engine::element::{
    EdgeBlock, EdgeChange, EdgeTension, EdgeVertices, TetrahedronEdges, TriangleEdges,
    rest_edge_bundle,
};
use sinew_engine::isoparametric::{RestHexahedron, RestTetrahedron10};
use sinew_engine::law::{BodiesWithoutRecovery, partition_laws};
use sinew_engine::layout::{BodyElements, BodyLayout, spread};
use sinew_engine::memory;
use sinew_engine::precision::Precision;
use sinew_engine::resource::ensure;
use sinew_engine::row::LocalRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::surface::{PointReader, SurfaceReader};
use sinew_engine::topology::{BodyRows, ElementTables, Topology};
use sinew_engine::vertex::{
    BodyId, Displacement, ElasticForce, ExternalForce, FixedAxes, Mass, Position,
    PrescribedDisplacement, RestPosition, Velocity, WeightShift,
};
use std::sync::Arc;

use super::clusters;
use super::description::{BodyDescription, BodyError, MassRule, SoftBody};
use super::lumped::{GivenSprings, SpringRule};
use super::matter::{Items, Matter, PooledSprings, chosen};
use super::sheet::{MembraneDescription, MembraneModel, Sheet};
use super::surface::read_surface;
use crate::axes::description::{AxesError, BodyAxes, validate_sheet};
use crate::axes::spawn::spawn_axes;
use crate::axes::systems::AxesOnly;
use crate::cutting::glue;
use crate::cutting::held::read_point;
use crate::element::plate::Neighbours;
use crate::element::precompute::RestTetrahedron;
use crate::frame::part::{
    Offsets, RestShapes, SolidPart, are_vertices, bad_vertices, rest_shapes, spawn_hexahedra,
    spawn_tetrahedra, spawn_tetrahedra10,
};
use crate::frame::row::{self, Elements, LawError, LawRow, LawTable};
use crate::frame::rules::{Evaluation, Integration, VolumeRule};
use crate::laws::bending;
use crate::laws::models::Model;
use crate::laws::pooled::{
    self, AngularStiffness, TensileStiffness, TensileTension, TriangleVertices, VolumetricStiffness,
};
use crate::laws::quadratic::{self, MassSpring};
use crate::laws::svk;
use crate::material::LameParameters;
use crate::material::field::MaterialArrays;
use crate::resection;

/// Memory (bytes) of a row of the vertex table, with what solvers keep for it.
const ROW: u64 = 2000;

/// Builds a body: orders the mesh, precomputes stiffnesses, spawns one entity per vertex, tetrahedron
/// and membrane triangle (per edge and triangle too when springs are pooled) and puts the laws it needs into
/// the force schedule. Its number type is the world's [`Precision`].
///
/// # Errors
/// When material or mesh cannot be used, or the world has no [`Precision`]; nothing is spawned then.
pub fn spawn_body(world: &mut World, body: &BodyDescription) -> Result<Entity, BodyError> {
    let (triangles, quads) =
        body.membrane.as_ref().map_or((0, 0), |m| (m.triangles.len(), m.quads.len()));
    let (tetrahedra, hexahedra) = (body.tetrahedra.len(), body.hexahedra.len());
    let needed = || {
        let counts = ByKind { tetrahedra, triangles, hexahedra, quads };
        let bends = body.membrane.is_some_and(|m| m.bending.is_some());
        let hinges = if bends { bending::MEMORY * triangles as u64 } else { 0 };
        let rows = ROW.saturating_mul(body.spare as u64);
        (memory::of_body(&counts, body.middles.len()) + hinges).saturating_add(rows)
    };
    memory::fits(&format!("body `{}`", body.name), needed)?;
    match world.get_resource::<Precision>() {
        Some(&precision) => {
            world.insert_resource(SurfaceReader(read_surface));
            world.insert_resource(PointReader(read_point));
            by_precision!(precision, spawn(world, body))
        }
        None => Err(BodyError::NoPrecision { body: body.name.to_string() }),
    }
}

fn spawn<S: Scalar>(world: &mut World, body: &BodyDescription) -> Result<Entity, BodyError> {
    let name = || body.name.to_string();
    let of_membrane = |source| BodyError::Membrane { body: name(), source };
    let (membrane, user_lame) = check(world, body)?;
    let tens = body.tetrahedra.iter().zip(body.middles);
    let tens: Vec<[u32; 10]> = tens.map(|(corners, middles)| ten(corners, middles)).collect();
    let nodes = ByKind {
        tetrahedra: if tens.is_empty() { body.tetrahedra.into() } else { tens.into() },
        triangles: membrane.map_or_else(PerElement::default, |m| m.triangles.into()),
        hexahedra: body.hexahedra.into(),
        quads: membrane.map_or_else(PerElement::default, |m| m.quads.into()),
    };
    let bends = membrane.is_some_and(|m| m.bending.is_some());
    let couplings = if bends { couplings } else { |_: &BodyElements| Vec::new() };
    let mut layout = BodyLayout::coupled(body.points.len(), &nodes, couplings);
    // rows that wait for cuts stand where the first vertex does
    layout.ordered.spare = body.spare;
    let rest_of = |row: u32| body.points[layout.vertex_of(LocalRow(row)).index()];
    let rest = RestShapes::new(body.name, &layout, &rest_of)?;
    let sheet = match &membrane {
        Some(m) => Some(Sheet::new(m, &layout, rest_of).map_err(of_membrane)?),
        None => None,
    };
    let (model, evaluation, spring_rule) = (body.model, body.evaluation, body.springs);
    let (rows, field) = (layout.row_count(), body.material_field());
    let (membrane, membrane_fibres) =
        (membrane.map(|m| m.settings()), membrane.map_or(&[][..], |m| m.fibres));
    let ordered = &layout.ordered;
    let (given, lumping) = (body.spring_constants.as_deref(), body.masses.lumping());
    let matter = Matter {
        ordered,
        rest_of: &rest_of,
        field,
        model,
        evaluation,
        spring_rule,
        given,
        lumping,
        equal_masses: body.masses == MassRule::Equal,
        membrane,
        families: body.axes.as_ref().map_or(&[][..], |axes| &axes.families),
        sheet_fibres: membrane_fibres,
    };
    let springs =
        matter.element_springs().map_err(|source| BodyError::Springs { body: name(), source })?;

    // from here on nothing can fail
    let all = chosen(ordered, |_, _| true);
    let lame: [Vec<LameParameters>; 2] =
        [ElementKind::Tetrahedron, ElementKind::Hexahedron].map(|kind| {
            all[kind].iter().map(|&e| model.lame(user_lame[matter.place(kind, e)])).collect()
        });
    let mut masses = matter.masses(Items::All(rows), &all);
    body.masses.apply(&mut masses);
    let shifts = matter.weight_shifts(Items::All(rows), &all);
    let [edges, triangles] =
        [layout.cells.edges.len(), layout.cells.triangles.len()].map(Items::All);
    let mass_spring = matter.edge_springs(&springs, &layout.cells, edges, &all);
    let pooled = matter.pooled_springs(&layout.cells, [edges, triangles], &all, &lame[0]);
    let at = add_rows(world, body.name, &layout, &rest_of);
    let clusters = match (body.volume, body.clusters) {
        (VolumeRule::Elements, _) => Vec::new(),
        (_, Some(given)) => {
            let own = layout.order.tetrahedra.iter().map(|&t| given[t as usize]);
            clusters::number(&own.collect::<Vec<_>>())
        }
        (_, None) if layout.tetrahedra().is_empty() => Vec::new(),
        (_, None) => clusters::grow(layout.vertex_order.len(), layout.tetrahedra(), &lame[0]),
    };
    let (compression, filled) = (model.has_compression(), matter.filled());
    let (layout, rest_of, rest) = (&layout, &rest_of, &rest);
    let part = SolidPart { layout, rest_of, rest, lame, filled, compression, clusters, at };
    part.spawn_vertices::<S>(world, &masses, &shifts);
    if model.softens() {
        report_compression::<S>(world, at.body.0);
    }
    part.spawn_edges::<S>(world, &mass_spring);
    let edge_rows = part.spawn_pooled_springs::<S>(world, &pooled);
    let law = model.law().map(|row| row::in_table(world, row).row);
    // springs, axes
    if law.is_none() {
        world.resource_mut::<BodiesWithoutRecovery>().insert(at.body.0 as usize);
    }
    let springs_of = (&edge_rows[..], &pooled.volumetric[..]);
    let rules = (evaluation, body.volume, body.integration);
    part.spawn::<S>(world, model, law, rules, springs_of);
    if let Some(sheet) = &sheet {
        let first = body.axes.as_ref().map_or(0, |axes| axes.families.len());
        sheet.spawn_fibres::<S>(world, layout, at, (membrane_fibres, first));
        sheet.spawn::<S>(world, layout, at);
    }
    if let Some(axes) = &body.axes {
        spawn_axes::<S>(world, axes, &part, evaluation);
    }
    let glue = glue::spawn::<S>(world, body.glue, &layout.cells, rest_of);
    partition_laws::<S>(world);
    resection::install::<S>(world);
    world.insert_resource(ElementTables::of(world));
    let axes = body.axes.as_ref().map(|axes| BodyAxes {
        description: axes.clone().into_owned(),
        repaired: axes.count_repairs(),
    });
    let soft = SoftBody {
        index: at.body.0 as usize,
        material: body.material,
        arrays: MaterialArrays::of(&field),
        model,
        law,
        evaluation,
        volume: body.volume,
        integration: body.integration,
        spring_rule,
        given: body.spring_constants.clone(),
        masses: body.masses,
        springs: Arc::new(springs),
        membrane,
        sheet_fibres: membrane_fibres.iter().map(|own| own.clone().into_owned()).collect(),
        glue,
        axes,
    };
    let entity = world.spawn(soft).id();
    if bends {
        bending::refresh::<S>(world, None);
    }
    Ok(entity)
}

/// Pairs of vertex rows that bending couples; a sheet that branches is refused elsewhere.
fn couplings(ordered: &BodyElements) -> Vec<[u32; 2]> {
    Neighbours::new(ordered.triangles().to_vec()).map_or(Vec::new(), |n| n.couplings())
}

/// Checks all that does not need the points in order; the membrane, if there is any, and the Lamé parameters
/// (Pa) of the solid elements in the user's order.
fn check<'a>(
    world: &mut World,
    body: &BodyDescription<'a>,
) -> Result<(Option<MembraneDescription<'a>>, Vec<LameParameters>), BodyError> {
    let name = || body.name.to_string();
    if ensure::<Topology>(world).body(body.name).is_some() {
        return Err(BodyError::Duplicate { body: name() });
    }
    if let Some(spawned) = world.get_resource::<ElementTables>()
        && *spawned != ElementTables::of(world)
    {
        return Err(BodyError::LayoutChanged { body: name() });
    }
    if !body.model.supports(body.evaluation) {
        return Err(BodyError::Evaluation { body: name(), model: body.model });
    }
    let membrane = body.membrane.filter(|m| !m.triangles.is_empty() || !m.quads.is_empty());
    let solid = !body.tetrahedra.is_empty() || !body.hexahedra.is_empty();
    let mut lame = Vec::new();
    if solid {
        lame = body
            .material_field()
            .lame(body.tetrahedra.len(), body.hexahedra.len())
            .map_err(|source| BodyError::Material { body: name(), source })?;
    } else if membrane.is_none() {
        return Err(BodyError::Empty { body: name() });
    }
    check_indices(body)?;
    if !body.middles.is_empty() {
        check_tetrahedra10(body)?;
    }
    if let Model::Own(law) = body.model {
        let of_law = |source| BodyError::Law { body: name(), source };
        if !matches!(law.elements, Elements::Tetrahedra | Elements::AxesInTetrahedra) {
            return Err(of_law(LawError::NotOfTetrahedra(law.info.name)));
        }
        ensure::<LawTable>(world).add(law).map_err(of_law)?;
    }
    if !body.hexahedra.is_empty() && !body.model.serves_hexahedra() {
        return Err(BodyError::HexahedronModel { body: name(), model: body.model });
    }
    if !body.hexahedra.is_empty() && !body.model.serves_hexahedra_by(body.integration) {
        return Err(BodyError::Integration { body: name(), model: body.model });
    }
    if body.volume == VolumeRule::Clusters {
        check_clusters(body, &lame)?;
    }
    if let Some(m) = &membrane {
        m.validate(body.points.len())
            .map_err(|source| BodyError::Membrane { body: name(), source })?;
        let solid = body.axes.as_ref().map_or(&[][..], |axes| &axes.families);
        let checked = validate_sheet(m.fibres, solid, m.triangles.len());
        checked.map_err(|source| BodyError::Axes { body: name(), source })?;
    }
    for rule in [body.springs, membrane.and_then(|m| m.springs)] {
        if let Some(SpringRule::Uniform(springs)) = rule
            && !springs.is_valid()
        {
            return Err(BodyError::SpringConstant { body: name(), value: springs.constant });
        }
    }
    check_glue(body)?;
    check_springs(body, membrane.as_ref())?;
    check_axes(body, solid).map_err(|source| BodyError::Axes { body: name(), source })?;
    Ok((membrane, lame))
}

/// What means of volumes need.
fn check_clusters(body: &BodyDescription, lame: &[LameParameters]) -> Result<(), BodyError> {
    let given = body.clusters.map_or(body.tetrahedra.len(), <[u32]>::len);
    let problem = if !body.model.keeps_mean_volume() {
        let those = Model::names_of(Model::keeps_mean_volume);
        format!("needs a model whose volume term can act on means: take {those}")
    } else if body.evaluation != Evaluation::Fused {
        "cannot be summed by pooled springs: take \"fused\"".into()
    } else if given != body.tetrahedra.len() {
        "was given a list of clusters of another length: it must name one for every tetrahedron"
            .into()
    } else if lame.iter().any(|lame| lame.lambda < 0.0) {
        "needs a Poisson's ratio of 0 or more: leave it out".into()
    } else {
        return Ok(());
    };
    Err(BodyError::Volume { body: body.name.to_string(), problem })
}

/// What glue needs.
fn check_glue(body: &BodyDescription) -> Result<(), BodyError> {
    let is_solid = !(body.tetrahedra.is_empty() && body.hexahedra.is_empty());
    let is_film = body.membrane.as_ref().is_some_and(|sheet| !sheet.triangles.is_empty());
    let problem = if !(body.glue >= 0.0 && body.glue.is_finite()) {
        format!("is {}: it must be 0 or positive, and finite", body.glue)
    } else if body.glue > 0.0 && !is_solid && !is_film {
        "holds wounds of tetrahedra, hexahedra and triangles: leave it out, or take these".into()
    } else {
        return Ok(());
    };
    Err(BodyError::Glue { body: body.name.to_string(), problem })
}

/// What ten-node tetrahedra need.
fn check_tetrahedra10(body: &BodyDescription) -> Result<(), BodyError> {
    let (all, given) = (body.tetrahedra.len(), body.middles.len());
    let problem = if all != given {
        format!("but {given} of {all} tetrahedra have vertices on their edges: give all or none")
    } else if !body.model.serves_tetrahedra10() && body.model != Model::Axes {
        let name = body.model.name();
        format!(
            "which model \"{name}\" is not made for: take \"svk_comp\", or a mesh of first order"
        )
    } else if body.evaluation != Evaluation::Fused {
        "which pooled springs cannot sum up: take evaluation = \"fused\"".into()
    } else if body.clusters.is_some() {
        "each of which keeps its own mean volume: leave the list of clusters out".into()
    } else {
        return Ok(());
    };
    Err(BodyError::Tetrahedra10 { body: body.name.to_string(), problem })
}

/// Vertices of a ten-node tetrahedron.
fn ten(&[a, b, c, d]: &[u32; 4], &[e, f, g, h, i, j]: &[u32; 6]) -> [u32; 10] {
    [a, b, c, d, e, f, g, h, i, j]
}

fn check_indices(body: &BodyDescription) -> Result<(), BodyError> {
    let count = body.points.len();
    let bad = |kind, index, vertices: &[u32]| {
        let (body, vertices) = (body.name.to_string(), vertices.to_vec());
        Err(BodyError::Index { body, kind, index, vertices, count })
    };
    for (tetrahedron, corners) in body.tetrahedra.iter().enumerate() {
        let middles = body.middles.get(tetrahedron).map(|middles| ten(corners, middles));
        let vertices = middles.as_ref().map_or(&corners[..], |ten| &ten[..]);
        if !are_vertices(vertices, count) {
            return bad(ElementKind::Tetrahedron, tetrahedron, vertices);
        }
    }
    match bad_vertices(body.hexahedra, count) {
        Some((index, vertices)) => bad(ElementKind::Hexahedron, index, vertices),
        None => Ok(()),
    }
}

/// Whether every element of springs has constants, where these are given.
fn check_springs(
    body: &BodyDescription,
    membrane: Option<&MembraneDescription>,
) -> Result<(), BodyError> {
    let Some(given) = &body.spring_constants else { return Ok(()) };
    fn missing<const N: usize>(
        given: &GivenSprings,
        kind: ElementKind,
        list: &[[u32; N]],
    ) -> Option<(ElementKind, usize)> {
        list.iter().position(|e| !given.has(kind, e)).map(|index| (kind, index))
    }
    let solid = body.model == Model::MassSpring;
    let solid = solid.then(|| {
        missing(given, ElementKind::Tetrahedron, body.tetrahedra)
            .or_else(|| missing(given, ElementKind::Hexahedron, body.hexahedra))
    });
    let sheet = membrane.filter(|m| m.model == MembraneModel::MassSpring).map(|m| {
        missing(given, ElementKind::Triangle, m.triangles)
            .or_else(|| missing(given, ElementKind::Quad, m.quads))
    });
    match solid.flatten().or(sheet.flatten()) {
        Some((kind, index)) => {
            Err(BodyError::MissingSprings { body: body.name.to_string(), kind, index })
        }
        None => Ok(()),
    }
}

fn check_axes(body: &BodyDescription, solid: bool) -> Result<(), AxesError> {
    let tetrahedra = body.tetrahedra.len();
    match &body.axes {
        Some(axes) => axes.validate(tetrahedra, body.hexahedra.len()),
        None if body.model == Model::Axes && solid => Err(AxesError::Missing),
        None => Ok(()),
    }
}

/// Appends the rows of a body to the topology; where they begin.
fn add_rows(
    world: &mut World,
    name: &str,
    layout: &BodyLayout,
    rest_of: &dyn Fn(u32) -> DVec3,
) -> Offsets {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for row in 0..layout.vertex_order.len() as u32 {
        low = low.min(rest_of(row));
        high = high.max(rest_of(row));
    }
    let mut topology = world.resource_mut::<Topology>();
    let index = topology.bodies.len();
    let size = (high - low).max_element();
    let rows = BodyRows::new(name.to_string(), layout.ordered.clone(), size);
    let first = topology.edges.len();
    topology.push(rows, &layout.cells.edges);
    if !layout.cells.couplings.is_empty() {
        // no element has them
        let count = topology.edges.len();
        topology.unused_edges.resize(count, false);
        for &edge in &layout.cells.couplings {
            topology.unused_edges[first + edge as usize] = true;
        }
    }
    let rows = &topology.bodies[index];
    let (vertex, block) = (rows.vertices.start, rows.blocks.start);
    Offsets { vertex, block, body: BodyId(index as u32) }
}

impl RestShapes {
    fn new(
        name: &str,
        layout: &BodyLayout,
        rest_of: &dyn Fn(u32) -> DVec3,
    ) -> Result<Self, BodyError> {
        let order = &layout.order;
        let tetrahedron = |points, tetrahedron| {
            RestTetrahedron::new(points).map_err(|source| BodyError::Tetrahedron {
                body: name.to_string(),
                tetrahedron,
                source,
            })
        };
        let at_points = |kind, index| {
            move |source| BodyError::Element { body: name.to_string(), kind, index, source }
        };
        let ten = |points, index| {
            RestTetrahedron10::new(points).map_err(at_points(ElementKind::Tetrahedron, index))
        };
        let hexahedron = |points, index| {
            RestHexahedron::new(points).map_err(at_points(ElementKind::Hexahedron, index))
        };
        Ok(Self {
            tetrahedra: rest_shapes(layout.tetrahedra(), &order.tetrahedra, rest_of, tetrahedron)?,
            tetrahedra10: rest_shapes(layout.tetrahedra10(), &order.tetrahedra, rest_of, ten)?,
            hexahedra: rest_shapes(layout.hexahedra(), &order.hexahedra, rest_of, hexahedron)?,
        })
    }
}

impl SolidPart<'_> {
    fn spawn_vertices<S: Scalar>(&self, world: &mut World, masses: &[f64], shifts: &[f64]) {
        let vertices = (0..).zip(masses.iter().zip(shifts)).map(|(row, (&mass, &shift))| {
            let x = (self.rest_of)(row);
            (
                RestPosition(x),
                Position(x),
                Displacement::<S>::default(),
                Velocity::<S>::default(),
                ElasticForce::<S>::default(),
                ExternalForce::<S>::default(),
                PrescribedDisplacement::<S>::default(),
                Mass(S::from_f64(mass)),
                WeightShift(S::from_f64(shift)),
                FixedAxes::NONE,
                self.layout.vertex_of(LocalRow(row)),
                self.at.body,
            )
        });
        world.spawn_batch(vertices.collect::<Vec<_>>());
    }

    /// Spawns the elements with the mark of their law; pooled tetrahedra with the edge-table rows of the edges of the
    /// layout, and their volumetric springs.
    fn spawn<S: Scalar>(
        &self,
        world: &mut World,
        model: Model,
        law: Option<&'static LawRow>,
        (evaluation, volume, integration): (Evaluation, VolumeRule, Integration),
        springs: (&[u32], &[[f64; 3]]),
    ) {
        type Alone = fn(&mut World, &SolidPart);
        // without a law: springs, or axes alone
        let kinds: [(Elements, bool, [Alone; 2]); 3] = [
            (
                Elements::Tetrahedra,
                self.rest.tetrahedra.is_empty(),
                [spawn_tetrahedra::<MassSpring, S>, spawn_tetrahedra::<AxesOnly, S>],
            ),
            (
                Elements::Tetrahedra10,
                self.rest.tetrahedra10.is_empty(),
                [spawn_tetrahedra10::<AxesOnly, S>; 2],
            ),
            (
                integration.hexahedra(),
                self.rest.hexahedra.is_empty(),
                [spawn_hexahedra::<MassSpring, S>, spawn_hexahedra::<AxesOnly, S>],
            ),
        ];
        for (elements, none, alone) in kinds {
            let pooled = evaluation == Evaluation::Pooled && elements == Elements::Tetrahedra;
            match law {
                _ if none => {}
                Some(_) if pooled => self.spawn_pooled::<S>(world, springs),
                // without one it was refused before
                Some(law) => {
                    if let Some(law) = law.in_elements(elements, volume) {
                        row::in_table(world, law).row.spawn::<S>(world, self);
                    }
                }
                None => alone[usize::from(model == Model::Axes)](world, self),
            }
        }
    }

    fn spawn_pooled<S: Scalar>(
        &self,
        world: &mut World,
        (edge_rows, volumetric): (&[u32], &[[f64; 3]]),
    ) {
        let constants = volumetric.iter().map(|&own| volumetric_bundle::<S>(own));
        let edges = self.layout.cells.edges_of.tetrahedra.each::<6>();
        let elements = self.tetrahedra::<S>().zip(edges).zip(constants);
        let elements = elements.map(|((tetrahedron, e), constants)| {
            (tetrahedron, TetrahedronEdges(e.map(|e| edge_rows[e as usize])), constants)
        });
        world.spawn_batch(elements.collect::<Vec<_>>());
        row::activate::<S>(world, &svk::PROJECTION);
        if self.compression {
            row::activate::<S>(world, &svk::COMPRESSION);
        }
    }

    /// Spawns the edges that are springs by themselves, if there are any.
    fn spawn_edges<S: Scalar>(&self, world: &mut World, tensile: &[f64]) {
        let edges: Vec<_> = self.edges::<S>(tensile).map(|edge| (edge, MassSpring)).collect();
        if !edges.is_empty() {
            world.spawn_batch(edges);
            row::activate::<S>(world, &quadratic::EDGE_SPRINGS);
        }
    }

    /// Spawns the edges and triangles of pooled elements, if there are any; edge-table rows of the
    /// edges of the layout.
    fn spawn_pooled_springs<S: Scalar>(
        &self,
        world: &mut World,
        springs: &PooledSprings,
    ) -> Vec<u32> {
        let mut edges = world.query::<&EdgeChange<S>>();
        let first = edges.iter(world).len() as u32;
        let mut rows = vec![first; springs.tensile.len()];
        for (row, edge) in (first..).zip(edges_with_springs(&springs.tensile)) {
            rows[edge] = row;
        }
        let edges = self.edges::<S>(&springs.tensile).map(|edge| {
            let change = EdgeChange::<S>::default();
            (edge, change, EdgeTension::<S>::default(), TensileTension::<S>::default())
        });
        let edges: Vec<_> = edges.collect();
        if edges.is_empty() {
            return rows;
        }
        world.spawn_batch(edges);
        let cells = &self.layout.cells;
        let triangles = spread(cells.triangles.len()).filter_map(|i| {
            let [a, b, c] = springs.angular[i]?.map(S::from_f64);
            Some((
                TriangleVertices(self.at.vertices(&cells.triangles[i])),
                TriangleEdges(cells.triangle_edges[i].map(|e| rows[e as usize])),
                self.at.body,
                AngularStiffness::<S, 0>(a),
                AngularStiffness::<S, 1>(b),
                AngularStiffness::<S, 2>(c),
            ))
        });
        world.spawn_batch(triangles.collect::<Vec<_>>());
        for row in pooled::SPRINGS {
            row::activate::<S>(world, row);
        }
        rows
    }

    /// Components of the edges that have a spring.
    fn edges<S: Scalar>(
        &self,
        tensile: &[f64],
    ) -> impl Iterator<Item = impl Bundle<Effect: NoBundleEffect>> {
        edges_with_springs(tensile).map(|i| {
            let edge = &self.layout.cells.edges[i];
            let [a, b] = edge.map(self.rest_of);
            (
                EdgeVertices(self.at.vertices(edge)),
                EdgeBlock(i as u32 + self.at.block),
                self.at.body,
                rest_edge_bundle::<S>((a - b).to_array()),
                TensileStiffness(S::from_f64(tensile[i])),
            )
        })
    }
}

/// Edges of the layout that have a spring, in the order of their table.
fn edges_with_springs(tensile: &[f64]) -> impl Iterator<Item = usize> {
    spread(tensile.len()).filter(|&edge| tensile[edge] != 0.0)
}

/// Columns of the volumetric springs of a pooled tetrahedron.
type Volumetric<S> =
    (VolumetricStiffness<S, 0>, VolumetricStiffness<S, 1>, VolumetricStiffness<S, 2>);

/// Volumetric springs (N/m^3) of a pooled tetrahedron.
pub(super) fn volumetric_bundle<S: Scalar>(constants: [f64; 3]) -> Volumetric<S> {
    let [a, b, c] = constants.map(S::from_f64);
    (VolumetricStiffness(a), VolumetricStiffness(b), VolumetricStiffness(c))
}
