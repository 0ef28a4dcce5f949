//! Tears: a body comes apart by itself where the tension in it is above its strength, or its wounds release more energy than its
//! toughness takes.
//!
//! What is compared with the strength is the largest principal value of the Cauchy stress, averaged over a ball by the volume of the material
//! in it: the stress of a single element at the end of a wound grows without bound as elements get smaller, the mean over a ball of
//! given radius does not. The ball is that of the shape at rest, the stress and the plane that it tears along are those of the present shape.
//!
//! With a toughness, the ends of wounds go on by the energy that they release per area instead of by that stress, while what begins at the
//! surface does so by strength. The stress at the end of a wound is as large as the ball is small, so that a strength is one of the
//! material only together with a radius; the energy release hardly depends on it. Were both asked, the lower load would win, and one of
//! the two would mean nothing. The energy release is the domain integral of Eshelby's stress. `q` is 1 up to three quarters of the radius and
//! falls to 0 at all of it, since the end of a wound in the mechanics is up to an element from that in the material; `q_i` at the vertices,
//! shape vectors `D_i`, forces `f_i`, energies `E` and displacement gradients `H` of the elements give
//!
//! ```text
//! c = -sum_e V_e (W_e I - H_e^T P_e) grad q = -sum_e sum_i q_i (E D_i + H^T f_i)      N, as f_i = -V P D_i
//! a = int q n ds                                                                      m, along the ends of wounds
//! G = c . a / |a|^2                                                                   J/m^2
//! ```
//!
//! `n` is the direction at rest in which the surface of the wound goes on, so that `a` is that of the ball, times the length of the front in it. The
//! outside of a body is not moved: there `c` counts along it only. Inertia does not count, and what holds or pulls must be outside of the ball. Where
//! nothing is under tension no wound goes on, and by stress do those whose ends face each other within the ball, which have no common direction.
//!
//! - At the end of a wound, by a cut or a tear, the cells there come apart by the plane through the line to which the wound has come, as near as
//!   may be to perpendicular to that stress. Where there is no wound, a tear begins at the vertex of the surface whose stress
//!   is the largest, farther than the radius from the end of any wound; only while no wound goes on.
//! - A step tears one layer of elements at most, and on the average no faster than `max_speed`.
//! - What comes apart is decided as for [blades](super::blade), by marks on edges, and opened by the same code: mass, momentum and energy are
//!   the same before and after. What the tear sets free goes into motion, and nothing holds its sides together: the law is brittle.
//! - Of several cuts the last one tears on; where an earlier one ends a new tear may begin.
//! - Hexahedra and ten-node tetrahedra tear by their strength alone. Their stress is the sum over their points.
//! - A body that is a membrane of triangles alone does so, too, along lines, and from any vertex. Its stress is that of its forces,
//!   where its material keeps its volume; the compression term counts as far as it pushes.
//! - After each step the decision depends on the state and the edits alone, so that snapshots and replays need nothing more.

use bevy_ecs::prelude::*;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use sinew_engine::compiled_here;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::element::{displacement_gradient, volume_change};
use sinew_engine::order::Order as Created;
use sinew_engine::resource::{ensure, put};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use std::sync::Arc;

use super::blade::{self, BladeViews};
use super::material::{Material, NONE, Order, real};
use super::stroke::{Progress, Uncut};
use super::{
    CutError, check_cut, kind_of, material_of, open_now, order_of, prepared, rest_of, row_of,
    soft_of,
};
use crate::body::description::SoftBody;
use crate::body::present::Resection;
use crate::element::projection::symmetric_eigen;
use crate::frame::row::{Elements, TetrahedronEnergy, TetrahedronForces};
use crate::frame::rules::VolumeRule;
use crate::resection::state::{Point, Queries, State, membrane_forces};

/// Least radius (mean edges) over which stress may be averaged: below, it is that of a few elements, and depends on the mesh.
const LEAST_RADIUS: f64 = 1.2;
/// The same for an energy release: nearer to the end of a wound than this the material does not know where that is.
const LEAST_RADIUS_OF_RELEASE: f64 = 1.5;
/// Least sine of the angle between the end of a wound and the tension there at which it tears on.
const ACROSS: f64 = 0.3;
/// Least length of the front in a ball in the direction that it has in common, of all of its length, for an energy release.
const COMMON: f64 = 1.0 / 3.0;

/// Lets a body tear.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[require(TearReport, Created)]
pub struct Tear {
    /// Index of the body.
    pub body: usize,
    /// Largest principal stress (Pa) that it bears.
    pub strength: f64,
    /// Energy (J/m^2, by area at rest) that the end of a wound takes to go on; it goes on by its strength without. Of linear tetrahedra alone.
    pub toughness: Option<f64>,
    /// Radius (m, at rest) of the ball over which stress is averaged, 1.2 mean edges at least, 1.5 with a toughness; these without.
    pub radius: Option<f64>,
    /// Largest speed (m/s) of a tear; without, that of shear waves, `sqrt(mu / rho)`.
    pub max_speed: Option<f64>,
}

/// What tears of a body did up to the last step.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TearReport {
    /// Area (m^2, at rest) of one side of what tore.
    pub area: f64,
    /// Elements that tears parted.
    pub separated: u32,
    /// Vertices that they made.
    pub vertices: u32,
    /// Tears that began without a wound.
    pub begun: u32,
    /// Largest averaged principal stress (Pa) at the ends of wounds, and where a tear may begin if it is above the strength there, as the last step began.
    pub stress: f64,
    /// Largest energy release (J/m^2) at the ends of wounds as the last step began; 0 without a toughness.
    pub energy_release: f64,
    /// Connected pieces of the body when it last tore.
    pub pieces: u32,
    /// Way (m) that a tear may still go at its largest speed.
    pub way: f64,
}

/// A body as tears look at it.
#[derive(Clone, Debug)]
pub(super) struct TearView {
    /// Count of its changes.
    of: u64,
    material: Arc<Material>,
    uncut: Arc<Uncut>,
    parts: Vec<Vec<u32>>,
    held: Vec<Option<[u32; 4]>>,
    progress: Progress,
    /// Cells at the ends of wounds, and where (m, at rest) these are.
    fronts: Vec<(u32, DVec3)>,
    /// Vertices of the mesh on its outside.
    outside: Vec<u32>,
    /// Places (m) at rest of the vertices of the mesh, and rows of these and of ghosts.
    rest: Vec<DVec3>,
    rows: Vec<u32>,
    /// Middles (m, at rest) of the material of all elements, by their first coordinate, and rows of these.
    middles: Vec<(DVec3, u32)>,
    /// Places (m) at rest of all rows, by their first coordinate.
    nodes: Vec<(DVec3, u32)>,
    /// Outward normals of the faces of the outside, and a row that each is at.
    normals: Vec<(u32, DVec3)>,
    /// Middles (m, at rest) of the edges at the ends of wounds, and lengths (m) of these in the directions in which the wounds go on.
    edges: Vec<(DVec3, DVec3)>,
}

/// Stress of an element times its volume (N m), and that volume (m^3).
type Stress = ([f64; 6], f64);

/// A tear with what it leaves open filled in, if the body can tear.
///
/// # Errors
/// Says why not, and what helps.
pub fn check_tear(world: &mut World, tear: &Tear) -> Result<Tear, CutError> {
    check_cut(world, tear.body)?;
    let rows = world.resource::<Topology>().bodies[tear.body].clone();
    let refuse = |problem: String| Err(CutError::Tear { body: rows.name.clone(), problem });
    let order = order_of(&rows);
    let Some(soft) = soft_of(world, tear.body) else { return refuse("it has no elements".into()) };
    let film = soft.membrane.filter(|_| order == Order::Triangles);
    if tear.toughness.is_some() && order != Order::Linear {
        let problem = "linear tetrahedra alone tear by a toughness; leave its toughness out";
        return refuse(problem.into());
    }
    if film.is_none() && soft.volume != VolumeRule::Elements {
        let problem = "means of volume have no stress of a place; take volume = \"elements\"";
        return refuse(problem.into());
    }
    if soft.glue.is_some() {
        return refuse("glue would hold its tears closed; build it without".into());
    }
    if film.is_none() && soft.membrane.is_some() {
        return refuse("what its membrane bears is not known; build it without".into());
    }
    if soft.axes.is_some() || !soft.sheet_fibres.is_empty() {
        return refuse(
            "the stress of its axes and fibres is not known; take a model without".into(),
        );
    }
    if film.is_none() && law_of(&soft).is_none() {
        return refuse(
            "its model does not tell the forces of single elements; take another".into(),
        );
    }
    let own = [
        ("strength", Some(tear.strength), "Pa"),
        ("toughness", tear.toughness, "J/m^2"),
        ("radius", tear.radius, "m"),
        ("max_speed", tear.max_speed, "m/s"),
    ];
    for (name, value, unit) in own {
        if let Some(value) = value.filter(|value| !(*value > 0.0 && value.is_finite())) {
            return refuse(format!("its {name} is {value} {unit}: it must be positive and finite"));
        }
    }
    let rest = rest_of(world, tear.body);
    let resection = prepared(world, tear.body)?;
    let material = material_of(
        world,
        tear.body,
        resection.bodies[tear.body].as_ref().expect("it was prepared"),
    );
    put(world, resection);
    let at_rest = |vertex: u32| rest[row_of(&rows, vertex) as usize];
    let edge = Uncut::new(&material).mean_edge(material.vertices, &at_rest);
    let release = tear.toughness.is_some();
    let least = edge * if release { LEAST_RADIUS_OF_RELEASE } else { LEAST_RADIUS };
    let radius = tear.radius.unwrap_or(least);
    if radius < least * (1.0 - 1e-9) {
        return refuse(format!(
            "its radius is {radius} m and edges are {edge:.4} m on average: what so few elements say depends on the mesh. \
             Take {least:.4} m or more, or a finer mesh"
        ));
    }
    let material = film.map_or(soft.material, |own| own.material);
    let (mu, rho) = (material.lame().map_or(0.0, |lame| lame.mu), material.density);
    let speed = tear.max_speed.or((mu > 0.0 && rho > 0.0).then(|| (mu / rho).sqrt()));
    Ok(Tear { radius: Some(radius), max_speed: speed, ..*tear })
}

fn law_of(soft: &SoftBody) -> Option<(TetrahedronEnergy, TetrahedronForces)> {
    let row = soft.law?.in_elements(Elements::Tetrahedra, soft.volume)?;
    row.energy.zip(row.element_forces)
}

/// Tears a body as far as it tears in a step of `dt` (s), from its state now.
///
/// # Errors
/// When it can tear no longer, or has too few spare vertices; nothing is changed then.
pub fn tear_body<S: Scalar>(
    world: &mut World,
    tear: &Tear,
    report: &mut TearReport,
    dt: f64,
) -> Result<(), CutError> {
    compiled_here!(S, advance(world: &mut World, tear: &Tear, report: &mut TearReport, dt: f64) -> Result<(), CutError>)
}

fn advance<S: Scalar>(
    world: &mut World,
    tear: &Tear,
    report: &mut TearReport,
    dt: f64,
) -> Result<(), CutError> {
    let body = tear.body;
    let changes = world.resource::<Topology>().bodies.get(body).map(|rows| rows.changes);
    let known =
        world.get_resource_mut::<BladeViews>().and_then(|mut views| views.tears.remove(&body));
    let view = match known.filter(|view| Some(view.of) == changes) {
        Some(view) => view,
        None => TearView::new(world, body)?,
    };
    let Tear { radius: Some(radius), max_speed, .. } = check_filled(world, tear)? else {
        return Ok(());
    };
    let layer = radius / LEAST_RADIUS;
    report.way = max_speed.map_or(layer, |speed| (report.way + speed * dt).min(layer + speed * dt));
    let at = blade::places::<S>(world, body);
    let (stresses, forces) = view.stresses::<S>(world, body, &at, tear.toughness.is_some());
    let (at, stresses, forces) = (&at[..], &stresses[..], &forces[..]);
    let look = Look { view: &view, at, stresses, forces, radius, tear };
    let mut progress =
        blade::going_on(world, body, &view.uncut).unwrap_or_else(|| view.progress.clone());
    let (apart, begun) = look.decide(&mut progress, report.way >= layer, report);
    if !apart.is_empty() {
        let goes_on = view.progress.has_opened();
        let stroke = view.uncut.stroke(&mut progress, apart, goes_on);
        let cut = open_now::<S>(world, body, &stroke)?;
        blade::go_on(world, body, progress);
        report.area += cut.area;
        report.separated += cut.separated.len() as u32;
        report.vertices += cut.vertices as u32;
        report.begun += u32::from(begun);
        report.pieces = cut.pieces as u32;
        report.way -= if max_speed.is_some() { layer } else { 0.0 };
    } else {
        ensure::<BladeViews>(world).tears.insert(body, view);
    }
    Ok(())
}

/// A tear whose body was not checked when it was given is checked now.
fn check_filled(world: &mut World, tear: &Tear) -> Result<Tear, CutError> {
    if tear.radius.is_some() { Ok(*tear) } else { check_tear(world, tear) }
}

impl TearView {
    fn new(world: &mut World, body: usize) -> Result<Self, CutError> {
        let resection = prepared(world, body)?;
        let own = resection.bodies[body].as_ref().expect("it was prepared");
        let material = material_of(world, body, own);
        let kind = kind_of(&world.resource::<Topology>().bodies[body]);
        let element_of = own.element_of[kind].clone();
        put(world, resection);
        let of_rows = rest_of(world, body);
        let own = &world.resource::<Topology>().bodies[body];
        let rest =
            (0..material.vertices).map(|v| of_rows[row_of(own, v) as usize]).collect::<Vec<_>>();
        let nodes = 0..material.vertices + material.ghosts.len() as u32;
        let rows = nodes.map(|node| row_of(own, node)).collect();
        let uncut = material.uncut.clone().unwrap_or_else(|| Arc::new(Uncut::new(&material)));
        let parts = material.parts();
        let held = material.held(&uncut, &parts);
        let progress = uncut.resume(&material, &held);
        let skin = material.skin();
        let faces = skin.iter().filter(|(_, _, wound)| !wound);
        let mut outside: Vec<u32> =
            faces.flat_map(|(face, ..)| *face).filter(|p| *p < material.vertices).collect();
        outside.sort_unstable();
        outside.dedup();
        let mut middles = middles(&material, &rest, &element_of);
        middles.sort_by(|a, b| a.0.x.total_cmp(&b.0.x).then(a.1.cmp(&b.1)));
        let mut nodes: Vec<(DVec3, u32)> = of_rows.iter().copied().zip(0..).collect();
        nodes.sort_by(|a, b| a.0.x.total_cmp(&b.0.x).then(a.1.cmp(&b.1)));
        let (fronts, normals, edges) = Default::default();
        let of = own.changes;
        let mut view = Self {
            of,
            material,
            uncut,
            parts,
            held,
            progress,
            fronts,
            outside,
            rest,
            rows,
            middles,
            nodes,
            normals,
            edges,
        };
        view.bound(&skin);
        for cell in view.uncut.fronts(&view.progress, &view.held) {
            let x = view.corners(cell, &|p| view.at_rest(p));
            view.fronts.push((cell, view.end(&view.progress, cell, &x).0));
        }
        Ok(view)
    }

    /// Finds the normals of the outside, and the edges at which both sides of a wound meet.
    fn bound(&mut self, skin: &[([u32; 3], u32, bool)]) {
        let mut sources: Vec<(u32, u32)> = self
            .rows
            .iter()
            .copied()
            .enumerate()
            .map(|(node, row)| {
                let node = node as u32;
                let ghost = node.checked_sub(self.material.vertices);
                (ghost.map_or(node, |ghost| self.material.ghosts[ghost as usize]), row)
            })
            .collect();
        sources.sort_unstable();
        let mut edges: Vec<([u32; 2], DVec3)> = Vec::new();
        for (face, _, wound) in skin {
            let x = face.map(|p| self.at_rest(p));
            let normal = (x[1] - x[0]).cross(x[2] - x[0]).normalize_or_zero();
            for i in 0..3 {
                let (from, to) = (face[i], face[(i + 1) % 3]);
                if *wound {
                    let on = (x[(i + 1) % 3] - x[i]).cross(normal);
                    edges.push(([from.min(to), from.max(to)], on));
                    continue;
                }
                let first = sources.partition_point(|(source, _)| *source < from);
                let of_point = sources[first..].iter().take_while(|(source, _)| *source == from);
                self.normals.extend(of_point.map(|&(_, row)| (row, normal)));
            }
        }
        edges.sort_by_key(|(edge, _)| *edge);
        for both in edges.chunk_by(|a, b| a.0 == b.0) {
            // those of one side go on in opposite directions
            if let [(edge, a), (_, b)] = both
                && a.dot(*b) > 0.0
            {
                let middle = 0.5 * (self.at_rest(edge[0]) + self.at_rest(edge[1]));
                self.edges.push((middle, 0.5 * (*a + *b)));
            }
        }
    }

    /// Place (m) of a point at rest.
    fn at_rest(&self, point: u32) -> DVec3 {
        at_rest(&self.material, &self.rest, point)
    }

    /// The corners of an uncut cell as its material has them; that which a triangle does not have is somewhere.
    fn corners(&self, cell: u32, place: &dyn Fn(u32) -> DVec3) -> [DVec3; 4] {
        self.uncut.corners(cell).map(|p| if p == NONE { DVec3::ZERO } else { place(p) })
    }

    /// The same in the present shape, where rows are at these places (m).
    fn present(&self, cell: u32, at: &[DVec3]) -> [DVec3; 4] {
        let node = |node: u32| at[self.rows[node as usize] as usize];
        let place = |p: u32| {
            let mut own =
                self.parts[cell as usize].iter().map(|&n| &self.material.cells[n as usize]);
            let part = own.find(|part| part.corners.contains(&p));
            part.map_or(DVec3::ZERO, |part| self.material.place(part, p, &node))
        };
        self.corners(cell, &place)
    }

    /// Middle of the marks that reach a cell whose corners are at `x` (m), and from one to another of them.
    fn end(&self, progress: &Progress, cell: u32, x: &[DVec3; 4]) -> (DVec3, DVec3) {
        let held = self.held[cell as usize].unwrap_or_default();
        let ends = self.uncut.ends(progress, cell, held);
        let marks: Vec<DVec3> = ends.map(|([a, b], at)| x[a].lerp(x[b], at)).collect();
        let mut along = DVec3::ZERO;
        for (i, a) in marks.iter().enumerate() {
            for b in &marks[i + 1..] {
                if (*b - *a).length_squared() > along.length_squared() {
                    along = *b - *a;
                }
            }
        }
        (marks.iter().sum::<DVec3>() / marks.len().max(1) as f64, along)
    }

    /// The stress of every element in the order of the middles, and the forces (N) by which energy falls as rows move in the material,
    /// of all rows if they are wanted.
    fn stresses<S: Scalar>(
        &self,
        world: &mut World,
        body: usize,
        at: &[DVec3],
        wanted: bool,
    ) -> (Vec<Stress>, Vec<DVec3>) {
        let Some(soft) = soft_of(world, body) else { return Default::default() };
        if self.material.order == Order::Triangles {
            return (self.membrane_stresses::<S>(world, body, at, &soft), Vec::new());
        }
        let Some((energy, forces)) = law_of(&soft) else { return Default::default() };
        let mut queries = Queries::<S>::new(world);
        let Some(own) = world.resource::<Resection>().bodies[body].as_ref() else {
            return Default::default();
        };
        let mut in_material = vec![DVec3::ZERO; if wanted { at.len() } else { 0 }];
        let state = State::new(own, world, &soft, &mut queries);
        let nodes = own.connectivity.ordered.tetrahedra();
        let kind = kind_of(&world.resource::<Topology>().bodies[body]);
        let of = |&(_, row): &(DVec3, u32)| {
            let mut stress = Stress::default();
            state.visit(kind, row, |point| {
                let Point::Solid(e, u) = point else { return };
                let gradient = displacement_gradient(&e.gradients, u);
                let volume = e.volume * (1.0 + volume_change(&gradient));
                let [d1, d2, d3] = e.gradients.map(DVec3::from);
                let transposed = DMat3::from_cols_array(&gradient);
                let forces = forces(e, u);
                if let (true, Some(forces)) = (wanted, forces) {
                    let energy = energy(e, u);
                    let shape = [-(d1 + d2 + d3), d1, d2, d3];
                    for (i, (d, f)) in shape.into_iter().zip(forces).enumerate() {
                        let row = nodes[row as usize][i] as usize;
                        in_material[row] -= energy * d + transposed * DVec3::from(f);
                    }
                }
                // edges of what stands for the element at this point, as they are now
                let edges = DMat3::from_cols(d1, d2, d3).inverse().transpose();
                let edges = (DMat3::IDENTITY + transposed.transpose()) * edges;
                let x = [DVec3::ZERO, edges.x_axis, edges.y_axis, edges.z_axis];
                let own = virial(forces.iter().flatten(), &x);
                stress.0.iter_mut().zip(own).for_each(|(sum, part)| *sum += part);
                stress.1 += volume;
            });
            stress
        };
        let stresses = self.middles.iter().map(of).collect();
        if wanted {
            for &(row, normal) in &self.normals {
                let force = &mut in_material[row as usize];
                *force -= force.dot(normal) * normal;
            }
        }
        (stresses, in_material)
    }

    /// The stress of every triangle of a body that is a membrane alone, in the order of the middles.
    fn membrane_stresses<S: Scalar>(
        &self,
        world: &mut World,
        body: usize,
        at: &[DVec3],
        soft: &SoftBody,
    ) -> Vec<Stress> {
        let mut queries = Queries::<S>::new(world);
        let own = world.resource::<Resection>().bodies[body].as_ref();
        let (Some(own), Some(sheet)) = (own, soft.membrane) else { return Vec::new() };
        let state = State::new(own, world, soft, &mut queries);
        let (ordered, kind) = (&own.connectivity.ordered, ElementKind::Triangle);
        let of = |&(_, row): &(DVec3, u32)| {
            let x = ordered.triangles()[row as usize].map(|v| at[v as usize]);
            let element = &self.material.elements[ordered.order[kind][row as usize] as usize];
            let [a, b, c] = [0, 1, 2].map(|i| self.rest[element.vertices[i] as usize]);
            let (share, area) = (element.share(), 0.5 * (b - a).cross(c - a).length());
            let mut stress = Stress::default();
            state.visit(kind, row, |point| {
                let Point::Sheet(e, u, _) = point else { return };
                let forces = membrane_forces(sheet.model, e, u);
                let sum = virial(forces.iter().flatten(), &x).map(|part| share * part);
                stress = (sum, share * area * sheet.thickness);
            });
            stress
        };
        self.middles.iter().map(of).collect()
    }
}

/// Place (m) of a point at rest, where the vertices of the mesh are at `rest`.
fn at_rest(material: &Material, rest: &[DVec3], point: u32) -> DVec3 {
    let point = &material.points[point as usize];
    let used = point.vertices.iter().zip(point.weights).filter(|(_, w)| *w != 0.0);
    used.map(|(&v, w)| w * rest[v as usize]).sum()
}

/// Middles (m) of the material at rest of elements that have any, and their rows.
fn middles(material: &Material, rest: &[DVec3], element_of: &[u32]) -> Vec<(DVec3, u32)> {
    let mut sums = vec![(DVec3::ZERO, 0.0); material.elements.len()];
    for cell in &material.cells {
        let corners = real(&cell.corners);
        let sum: DVec3 = corners.iter().map(|&p| at_rest(material, rest, p)).sum();
        let (all, volume) = &mut sums[cell.element as usize];
        *all += cell.volume / corners.len() as f64 * sum;
        *volume += cell.volume;
    }
    let own = sums.into_iter().zip(element_of).filter(|((_, volume), _)| *volume > 0.0);
    own.map(|((sum, volume), row)| (sum / volume, *row)).collect()
}

/// What forces (N) of an element on vertices at these places (m) say of its stress, times its volume (N m): `xx, yy, zz, yz, xz, xy`.
fn virial<'a>(forces: impl Iterator<Item = &'a [f64; 3]>, x: &[DVec3]) -> [f64; 6] {
    let mut sum = [0.0; 6];
    for (f, at) in forces.zip(x) {
        let (f, x) = (DVec3::from(*f), *at - x[0]);
        let both = |i: usize, j: usize| -0.5 * (f[i] * x[j] + f[j] * x[i]);
        let of = [both(0, 0), both(1, 1), both(2, 2), both(1, 2), both(0, 2), both(0, 1)];
        sum.iter_mut().zip(of).for_each(|(sum, part)| *sum += part);
    }
    sum
}

/// Largest principal value (Pa) and its direction.
fn principal((t, volume): Stress) -> (f64, DVec3) {
    // nothing there, or turned inside out
    if volume <= 0.0 || volume.is_nan() {
        return (0.0, DVec3::ZERO);
    }
    let [xx, yy, zz, yz, xz, xy] = t.map(|t| t / volume);
    let (values, v) = symmetric_eigen([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], true);
    let last = (1..3).fold(0, |best, i| if values[i] > values[best] { i } else { best });
    (values[last], DVec3::new(v[0][last], v[1][last], v[2][last]))
}

/// What of places (m) by their first coordinate is in a ball.
fn near(places: &[(DVec3, u32)], at: DVec3, radius: f64) -> impl Iterator<Item = usize> + '_ {
    let first = places.partition_point(|(x, _)| x.x < at.x - radius);
    let end = places.partition_point(|(x, _)| x.x <= at.x + radius);
    (first..end).filter(move |&i| places[i].0.distance_squared(at) <= radius * radius)
}

/// A body and its stress.
struct Look<'a> {
    view: &'a TearView,
    at: &'a [DVec3],
    stresses: &'a [Stress],
    /// Forces (N) on rows in the material, if a toughness is given.
    forces: &'a [DVec3],
    radius: f64,
    tear: &'a Tear,
}

impl Look<'_> {
    /// What stands in a ball round a place (m, at rest).
    fn near(&self, at: DVec3) -> impl Iterator<Item = usize> + '_ {
        near(&self.view.middles, at, self.radius)
    }

    /// The energy (J/m^2) that the ends of wounds round one of them (m, at rest) release as they go on, if there is such a direction.
    fn energy_release(&self, at: DVec3) -> Option<f64> {
        let part = |x: DVec3| (4.0 - 4.0 * x.distance(at) / self.radius).clamp(0.0, 1.0);
        let (mut way, mut length) = (DVec3::ZERO, 0.0);
        for &(middle, on) in &self.view.edges {
            way += part(middle) * on;
            length += part(middle) * on.length();
        }
        if self.forces.is_empty() || way.length() <= COMMON * length {
            return None;
        }
        let nodes = &self.view.nodes;
        let force = near(nodes, at, self.radius)
            .map(|i| part(nodes[i].0) * self.forces[nodes[i].1 as usize])
            .sum::<DVec3>();
        Some(force.dot(way) / way.length_squared())
    }

    /// The largest principal value of the mean stress (Pa) there, and its direction.
    fn mean(&self, at: DVec3) -> (f64, DVec3) {
        let mut sum = Stress::default();
        for i in self.near(at) {
            let own = &self.stresses[i];
            sum.0.iter_mut().zip(own.0).for_each(|(sum, part)| *sum += part);
            sum.1 += own.1;
        }
        principal(sum)
    }

    /// Cells that come apart, ascending, if any may, and whether a tear begins.
    fn decide(
        &self,
        progress: &mut Progress,
        may: bool,
        report: &mut TearReport,
    ) -> (Vec<u32>, bool) {
        let view = self.view;
        let look = |&(_, at): &(u32, DVec3)| (self.mean(at), self.energy_release(at));
        let fronts: Vec<_> = view.fronts.iter().map(look).collect();
        report.stress = fronts.iter().map(|(mean, _)| mean.0).fold(0.0, f64::max);
        report.energy_release = fronts.iter().filter_map(|own| own.1).fold(0.0, f64::max);
        let mut apart = Vec::new();
        if !may {
            return (apart, false);
        }
        for (&(cell, _), &((stress, across), release)) in view.fronts.iter().zip(&fronts) {
            let goes_on = match (release, self.tear.toughness) {
                (Some(release), Some(toughness)) => stress > 0.0 && release > toughness,
                _ => stress > self.tear.strength,
            };
            if !goes_on {
                continue;
            }
            let x = view.present(cell, self.at);
            let (on, along) = view.end(progress, cell, &x);
            let along = along.normalize_or_zero();
            let normal = across - across.dot(along) * along;
            if normal.length() >= ACROSS {
                self.part(&view.uncut.together(cell), [on, normal], progress, &mut apart);
            }
        }
        // one thing after the other: what goes on takes tension off what may begin
        let begun = apart.is_empty() && self.begin(progress, &mut apart, &mut report.stress);
        if !apart.is_empty() {
            apart.extend(view.uncut.close(progress, &view.held));
        }
        apart.sort_unstable();
        apart.dedup();
        (apart, begun)
    }

    /// Begins a tear at the vertex of the surface that is under the largest tension, if that is above the strength.
    fn begin(&self, progress: &mut Progress, apart: &mut Vec<u32>, largest: &mut f64) -> bool {
        let (view, strength) = (self.view, self.tear.strength);
        // the norm of all is no less than the largest principal value
        let norm = |t: &[f64; 6]| {
            t[..3].iter().map(|t| t * t).sum::<f64>()
                + 2.0 * t[3..].iter().map(|t| t * t).sum::<f64>()
        };
        let may = |own: &Stress| norm(&own.0).sqrt() > strength * own.1;
        let is_hot = |own: &Stress| may(own) && principal(*own).0 > strength;
        let all = view.middles.iter().zip(self.stresses);
        let hot: Vec<DVec3> =
            all.filter(|(_, own)| is_hot(own)).map(|(middle, _)| middle.0).collect();
        let mut found: Vec<(f64, u32, DVec3)> = Vec::new();
        for &vertex in &view.outside {
            let at = view.rest[vertex as usize];
            let near = |x: &DVec3| x.distance_squared(at) <= self.radius * self.radius;
            // a mean is above the strength only where a part of it is
            if !hot.iter().any(near) || view.fronts.iter().any(|(_, end)| near(end)) {
                continue;
            }
            let (stress, across) = self.mean(at);
            if stress > strength {
                found.push((stress, vertex, across));
            }
        }
        // the first of equals; nothing comes apart at a corner that the plane only touches
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        *largest = found.first().map_or(*largest, |own| largest.max(own.0));
        found.into_iter().any(|own| self.begin_at(own, progress, apart))
    }

    /// Lets a tear begin at a vertex by the plane across a direction; whether it does.
    fn begin_at(
        &self,
        (_, vertex, across): (f64, u32, DVec3),
        progress: &mut Progress,
        apart: &mut Vec<u32>,
    ) -> bool {
        let view = self.view;
        // to the side on which there is more tension, whatever the sign of the direction
        let at = view.rest[vertex as usize];
        let pull = self
            .near(at)
            .map(|i| self.stresses[i].0[..3].iter().sum::<f64>() * (view.middles[i].0 - at));
        let across = if pull.sum::<DVec3>().dot(across) < 0.0 { -across } else { across };
        let before = apart.len();
        for cell in view.uncut.round(vertex) {
            let i = view.uncut.corners(cell).iter().position(|p| *p == vertex).unwrap_or(0);
            let on = view.present(cell, self.at)[i];
            self.part(&view.uncut.together(cell), [on, across], progress, apart);
        }
        apart.len() > before
    }

    /// Prolongs a wound through cells that come apart together.
    fn part(
        &self,
        cells: &[u32],
        plane: [DVec3; 2],
        progress: &mut Progress,
        apart: &mut Vec<u32>,
    ) {
        let view = self.view;
        for &cell in cells {
            let Some(held) = view.held[cell as usize].filter(|_| !apart.contains(&cell)) else {
                continue;
            };
            let x = view.present(cell, self.at);
            if view.uncut.prolong(progress, (cell, held), x, plane) {
                apart.push(cell);
            }
        }
    }
}
