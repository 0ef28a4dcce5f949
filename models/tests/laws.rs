//! The table of laws: every row is reached, evaluates all its elements and is told by its name; rows of other
//! crates take their place beside them.

use crate::common::bodies::{MATERIAL, Meshes};
use crate::common::{KINDS, empty};
use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryBuilder;
use bytemuck::TransparentWrapper;
use glam::DVec3;
use sinew_engine::element::{AxisBlocks, AxisVertices, TETRAHEDRON_EDGES};
use sinew_engine::law::{
    DisabledLaws, ElasticEnergy, EvaluationRequest, LawBuffers, LawInfo, TangentKind,
    partition_laws,
};
use sinew_engine::load::{Curve, Pressure};
use sinew_engine::matrix::{ProductSpans, Tangent};
use sinew_engine::mesh::Mesh;
use sinew_engine::mesh::generate::box_tets;
use sinew_engine::resource::ensure;
use sinew_engine::row::VertexRow;
use sinew_engine::scalar::{Real, Scalar};
use sinew_engine::schedule::{self, ActiveLaws, DampingSchedule, ForceSchedule, changed_laws};
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{BodyId, Displacement, ElasticForce};
use sinew_engine::workers::Workers;
use sinew_models::axes::site::{AxisSite, add_blocks, add_spread, local, spread_over};
use sinew_models::body::{BodyDescription, BodyError, Model, VolumeRule, spawn_body};
use sinew_models::element::precompute::RestTetrahedron;
use sinew_models::element::tetrahedron::{Element, TetrahedronTangent};
use sinew_models::frame::law::TetrahedronLaw;
use sinew_models::frame::row::{
    Elements, LawError, LawRow, LawTable, PlacedLaw, activate, activate_elements, mark,
};
use sinew_models::laws::LAWS;
use sinew_models::laws::linear::Linear;
use sinew_models::laws::pressure;
use sinew_models::material::YoungPoisson;
use std::collections::BTreeSet;

fn tetrahedra() -> Mesh {
    box_tets(DVec3::new(0.2, 0.1, 0.1), [4, 2, 2]).unwrap()
}

fn evaluate(world: &mut World, tangent: TangentKind) {
    let tangent = Some(tangent);
    world.insert_resource(EvaluationRequest { energy: true, force: true, tangent });
    world.run_schedule(ForceSchedule);
    if world.resource::<Schedules>().contains(DampingSchedule) {
        world.run_schedule(DampingSchedule);
    }
}

fn disturb<S: Scalar>(world: &mut World) {
    let mut state = 7_u64;
    for mut u in world.query::<&mut Displacement<S>>().iter_mut(world) {
        for x in 0..3 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            u.0[x] = S::from_f64(1e-2 * ((state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0));
        }
    }
}

/// Spawns a body and checks that its laws are rows of the table, hold all of its elements and are told in the
/// order of the table.
fn walk<S: Scalar>(body: &BodyDescription, pressed: bool, reached: &mut BTreeSet<&'static str>) {
    let mut world = empty::<S>();
    spawn_body(&mut world, body).unwrap_or_else(|e| panic!("{e}"));
    if pressed {
        let rows = &world.resource::<Topology>().bodies[0];
        let tens = rows.tetrahedra10().iter().map(|t| [t[0], t[1], t[2]]);
        let corners = rows.tetrahedra().iter().map(|t| [t[0], t[1], t[2]]).chain(tens);
        let faces = corners.chain(rows.hexahedra().iter().map(|h| [h[0], h[1], h[2]])).take(1);
        let faces = faces.map(|face| face.map(VertexRow)).collect();
        let curve = Curve::Constant;
        world.spawn(Pressure { name: "p".into(), faces, pressure: 10.0, curve });
        pressure::activate::<S>(&mut world);
    }
    disturb::<S>(&mut world);
    let counts = |elements| match elements {
        Elements::Tetrahedra | Elements::PooledTetrahedra | Elements::Tetrahedra10 => {
            Some(body.tetrahedra.len())
        }
        Elements::Hexahedra | Elements::ReducedHexahedra => Some(body.hexahedra.len()),
        Elements::Triangles => Some(body.membrane.unwrap().triangles.len()),
        Elements::Quads => Some(body.membrane.unwrap().quads.len()),
        Elements::Faces => Some(usize::from(pressed)),
        // nothing was cut
        Elements::Bonds => Some(0),
        _ => None,
    };
    for kind in KINDS {
        evaluate(&mut world, kind);
        let buffers = world.resource::<LawBuffers<S>>();
        let mut active = Vec::new();
        for row in LAWS {
            let Some(buffer) = buffers.get(row.info.name) else { continue };
            let name = row.info.name;
            reached.insert(name);
            match counts(row.elements) {
                Some(count) => assert_eq!(buffer.element_count(), count, "{name}"),
                None => assert!(buffer.element_count() > 0, "{name} evaluates nothing"),
            }
            let whole = matches!(
                row.elements,
                Elements::Tetrahedra
                    | Elements::Tetrahedra10
                    | Elements::Hexahedra
                    | Elements::ReducedHexahedra
                    | Elements::Triangles
                    | Elements::Quads
            );
            if whole && row.forces && !name.contains("compression") {
                assert!(buffer.energy() > 0.0, "{name}: {}", buffer.energy());
            }
            let in_tangent = buffer.spans.iter().any(|span| !span.diagonal.is_empty());
            if buffer.element_count() > 0 {
                assert_eq!(in_tangent, (row.tangent)(kind) || row.is_damper, "{name} {kind:?}");
            }
            if !row.is_damper {
                active.push(name);
            }
        }
        let told: Vec<_> =
            world.resource::<ElasticEnergy>().by_law.iter().map(|(name, _)| *name).collect();
        assert_eq!(told, active, "told in the order of the table");
        let known = |name: &&str| {
            LAWS.iter()
                .any(|row| row.info.name == *name || row.measure.is_some_and(|m| m.name == *name))
        };
        let laws = &world.resource::<ActiveLaws>().0;
        assert!(laws.iter().all(|name| known(name) || *name == "edge changes"), "{laws:?}");
    }
}

fn walk_all<S: Scalar>() {
    let meshes = Meshes::new([4, 2, 2]);
    let mut reached = BTreeSet::new();
    for body in meshes.bodies() {
        let solid = body.membrane.is_none() && body.model != Model::Axes;
        walk::<S>(&body, solid, &mut reached);
    }
    let missing: Vec<_> =
        LAWS.iter().map(|row| row.info.name).filter(|name| !reached.contains(name)).collect();
    assert!(missing.is_empty(), "rows that no body reached: {missing:?}");
}

#[test]
fn every_row_of_the_table_is_reached_in_double_precision() {
    walk_all::<f64>();
}

#[test]
fn every_row_of_the_table_is_reached_in_single_precision() {
    walk_all::<f32>();
}

#[test]
fn names_are_unique() {
    let names: BTreeSet<_> = LAWS.iter().map(|row| row.info.name).collect();
    assert_eq!(names.len(), LAWS.len());
    for row in LAWS.iter().flat_map(|row| row.family) {
        assert!(LAWS.contains(row), "{} is a row of its own", row.info.name);
    }
}

/// `W = V mu/2 |G|^2` of the displacement gradient `G`, by the name `name`.
macro_rules! laplacian {
    ($law:ident, $row:ident, $name:expr) => {
        #[derive(Component, Clone, Copy, Debug, Default)]
        struct $law;

        static $row: LawRow = LawRow::tetrahedra::<$law>();

        impl TetrahedronLaw for $law {
            const NAME: &'static str = $name;
            type Mark = Self;
            const STRESS_PROJECTION: bool = false;
            fn contributes(_: TangentKind) -> bool {
                true
            }
            fn energy<R: Real>(e: &Element<R>, u: &[[R; 3]; 4]) -> R {
                let f = Self::forces(e, u).unwrap();
                let mut work = R::ZERO;
                for a in 0..4 {
                    for x in 0..3 {
                        work -= f[a][x] * u[a][x];
                    }
                }
                work * R::from_f64(0.5)
            }
            fn forces<R: Real>(e: &Element<R>, u: &[[R; 3]; 4]) -> Option<[[R; 3]; 4]> {
                let k = Self::tangent(e, u, TangentKind::Exact).product(u);
                Some(k.map(|f| f.map(|x| -x)))
            }
            fn tangent<R: Real>(
                e: &Element<R>,
                _: &[[R; 3]; 4],
                _: TangentKind,
            ) -> TetrahedronTangent<R> {
                let d = &e.gradients;
                let mut all = [[R::ZERO; 3], d[0], d[1], d[2]];
                for x in 0..3 {
                    all[0][x] = -(d[0][x] + d[1][x] + d[2][x]);
                }
                let block = |a: usize, b: usize| {
                    let k = sinew_engine::scalar::dot(all[a], all[b]) * e.mu * e.volume;
                    let o = R::ZERO;
                    [k, o, o, o, k, o, o, o, k]
                };
                TetrahedronTangent {
                    diagonal: [block(0, 0), block(1, 1), block(2, 2), block(3, 3)],
                    off: [
                        block(0, 1),
                        block(0, 2),
                        block(0, 3),
                        block(1, 2),
                        block(1, 3),
                        block(2, 3),
                    ],
                }
            }
        }
    };
}
laplacian!(Laplacian, LAPLACIAN, "Laplacian of a test");
laplacian!(Instead, INSTEAD, Linear::NAME);

fn energy_of(world: &mut World) -> f64 {
    evaluate(world, TangentKind::Exact);
    world.resource::<ElasticEnergy>().total
}

#[test]
fn a_law_of_another_crate_is_a_row_and_a_model() {
    let mesh = tetrahedra();
    let (lame, shear) = (MATERIAL.lame().unwrap(), 0.3);
    let body = BodyDescription {
        model: Model::Own(&LAPLACIAN),
        ..BodyDescription::new("b", &mesh, MATERIAL)
    };
    let mut world = empty::<f64>();
    spawn_body(&mut world, &body).unwrap();
    // simple shear: W = V mu/2 shear^2
    let rows = world.query::<(&sinew_engine::vertex::RestPosition, &mut Displacement<f64>)>();
    let mut rows = rows;
    for (x, mut u) in rows.iter_mut(&mut world) {
        u.0[0] = shear * x.0.z;
    }
    let expected = 0.5 * lame.mu * shear * shear * 0.2 * 0.1 * 0.1;
    assert!((energy_of(&mut world) - expected).abs() < 1e-12 * expected);
    assert_eq!(world.resource::<LawTable>().rows().len(), LAWS.len() + 1);

    // switched off, it is neither evaluated nor told, and solvers learn that forces have changed
    let before = world.change_tick();
    world.increment_change_tick();
    assert_eq!(changed_laws(&mut world, before), Some(vec![]));
    world.resource_mut::<DisabledLaws>().0.push(Laplacian::NAME);
    assert_eq!(changed_laws(&mut world, before), Some(vec![Laplacian::NAME]));
    assert_eq!(energy_of(&mut world), 0.0);
    assert!(world.resource::<ElasticEnergy>().by_law.is_empty());
    let mut forces = world.query::<&ElasticForce<f64>>();
    assert!(forces.iter(&world).all(|f| f.0 == [0.0; 4]));
    world.resource_mut::<DisabledLaws>().0.clear();
    assert!((energy_of(&mut world) - expected).abs() < 1e-12 * expected);
}

#[test]
fn rows_take_the_place_of_shipped_ones() {
    let mesh = tetrahedra();
    let linear =
        BodyDescription { model: Model::Linear, ..BodyDescription::new("b", &mesh, MATERIAL) };
    let mut world = empty::<f64>();
    ensure::<LawTable>(&mut world).replace(&INSTEAD).unwrap();
    spawn_body(&mut world, &linear).unwrap();
    disturb::<f64>(&mut world);
    let replaced = energy_of(&mut world);
    let own = BodyDescription { model: Model::Own(&LAPLACIAN), ..linear.clone() };
    let mut other = empty::<f64>();
    spawn_body(&mut other, &own).unwrap();
    disturb::<f64>(&mut other);
    assert_eq!(replaced, energy_of(&mut other));

    // a name that is taken, and one that nobody has
    let taken = BodyDescription { model: Model::Own(&INSTEAD), ..linear.clone() };
    let error = spawn_body(&mut empty::<f64>(), &taken).unwrap_err();
    assert!(matches!(error, BodyError::Law { source: LawError::Duplicate(Linear::NAME), .. }));
    assert!(error.to_string().contains("`b`") && error.to_string().contains(Linear::NAME));
    let mut table = LawTable::default();
    assert_eq!(table.replace(&LAPLACIAN), Err(LawError::Unknown(Laplacian::NAME)));
    // a law of other elements
    let linear_law = Model::Linear.law().unwrap();
    let hexahedra = linear_law.in_elements(Elements::Hexahedra, VolumeRule::Elements).unwrap();
    let wrong = BodyDescription { model: Model::Own(hexahedra), ..linear };
    let error = spawn_body(&mut empty::<f64>(), &wrong).unwrap_err();
    assert!(error.to_string().contains("acts neither on tetrahedra nor on axes"), "{error}");
}

/// A tie along x in a tetrahedron, as another crate would have it: `W = k/2 (sum_a q_a u_a)^2`.
#[derive(Component, Clone, Copy)]
#[component(summary_tick)]
struct Tie {
    shape: [f64; 4],
    stiffness: f64,
}

static TIES: LawRow = LawRow::of_systems(
    LawInfo::elastic("ties of a test"),
    Elements::AxesInTetrahedra,
    [mark::<Tie>; 2],
    [ties::<f64>, ties::<f32>],
);

fn ties<S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_elements::<AxisVertices, S, (&AxisVertices, &AxisBlocks, &Tie)>(
        world,
        law,
        |schedule::Evaluation { workers, .. }, u, (sites, blocks, ties), buffer| {
            let u = Displacement::peel_slice(u);
            workers.for_each(&mut buffer.spans, 100 * ties.len(), |_, span| {
                span.clear_force();
                span.clear_tangent();
                span.energy = 0.0;
                for i in span.elements.clone() {
                    let Tie { shape, stiffness } = ties[i];
                    let stretch = spread_over(&shape, &local(u, sites[i].rows()))[0];
                    span.energy += 0.5 * stiffness * stretch * stretch;
                    for (&v, q) in sites[i].rows().iter().zip(shape) {
                        let pull = S::from_f64(-q * stiffness * stretch);
                        span.add_force(v, [pull, S::ZERO, S::ZERO]);
                    }
                    let mut along = [0.0; 9];
                    along[0] = stiffness;
                    let mut matrix = [[[0.0; 9]; 4]; 4];
                    add_spread(&mut matrix, &shape, &shape, &along);
                    add_blocks(span, &sites[i], &blocks[i], &matrix);
                }
            });
        },
    );
}

/// Also that [`activate`] and the ranges take elements that were spawned after their body.
#[test]
fn a_law_of_axes_of_another_crate_is_a_row() {
    let mesh = tetrahedra();
    let mut world = empty::<f64>();
    spawn_body(&mut world, &BodyDescription::new("b", &mesh, MATERIAL)).unwrap();
    let topology = world.resource::<Topology>();
    let block = |[a, b]: [u32; 2]| topology.block(a, b).unwrap();
    let own = topology.bodies[0].tetrahedra().iter().enumerate().map(|(i, t)| {
        let blocks = TETRAHEDRON_EDGES.map(|pair| block(pair.map(|v| t[v])));
        let tie = Tie { shape: [-1.0, 0.25, 0.5, 0.25], stiffness: 1.0 + i as f64 };
        (AxisVertices(*t), AxisBlocks(blocks), BodyId(0), tie)
    });
    let own: Vec<_> = own.collect();
    world.spawn_batch(own.clone());
    ensure::<LawTable>(&mut world).add(&TIES).unwrap();
    activate::<f64>(&mut world, &TIES);
    partition_laws::<f64>(&mut world);
    let others = LAWS.iter().map(|row| row.info.name);
    world.insert_resource(DisabledLaws(others.collect()));
    disturb::<f64>(&mut world);

    let energy = energy_of(&mut world);
    let u: Vec<[f64; 4]> = world.query::<&Displacement<f64>>().iter(&world).map(|u| u.0).collect();
    let stretch = |(rows, _, _, tie): &(AxisVertices, AxisBlocks, BodyId, Tie)| {
        let along = rows.0.iter().zip(tie.shape).map(|(&v, q)| q * u[v as usize][0]);
        along.sum::<f64>()
    };
    let expected: f64 = own.iter().map(|a| 0.5 * a.3.stiffness * stretch(a).powi(2)).sum();
    assert!((energy - expected).abs() < 1e-12 * expected, "{energy} {expected}");
    // quadratic from rest: f = -K u
    let (mut spans, mut product) = (ProductSpans::default(), vec![[0.0; 4]; u.len()]);
    let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
    let tangent = world.resource::<Tangent<f64>>();
    tangent.multiply(topology, workers, &mut spans, &u, &mut product);
    let forces: Vec<[f64; 4]> =
        world.query::<&ElasticForce<f64>>().iter(&world).map(|f| f.0).collect();
    let size = forces.as_flattened().iter().fold(0.0_f64, |most, f| most.max(f.abs()));
    for (f, k) in forces.as_flattened().iter().zip(product.as_flattened()) {
        assert!((f + k).abs() < 1e-12 * size, "{f} {k}");
    }
}

/// What rows say of themselves at large strain is true of their energies: those that hold any pressure grow faster than the
/// volume when an element is blown up, and those that soften resist a strong compression less and less.
#[test]
fn rows_know_their_energies_at_large_strain() {
    let rest = RestTetrahedron::new([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let lame = YoungPoisson { poisson_ratio: 0.45, ..MATERIAL }.lame().unwrap();
    let element = Element::<f64>::new(&rest.unwrap(), lame, false);
    let stretched = |row: &LawRow, [x, y, z]: [f64; 3]| {
        let energy = row.energy.unwrap();
        energy(&element, &[[0.0; 3], [x - 1.0, 0.0, 0.0], [0.0, y - 1.0, 0.0], [0.0, 0.0, z - 1.0]])
    };
    let mut seen = 0;
    for row in LAWS.iter().filter(|row| row.energy.is_some() && row.forces) {
        let name = row.info.name;
        if name == "compression term" {
            continue;
        }
        let degree = (stretched(row, [1e4; 3]) / stretched(row, [1e3; 3])).log10();
        assert_eq!(row.holds_pressure, degree > 3.5, "{name} grows with degree {degree}");
        let [less, here, more] = [0.4, 0.45, 0.5].map(|s| stretched(row, [s, 1.0, 1.0]));
        let bend = less - 2.0 * here + more;
        assert_eq!(row.softens, bend < 0.0, "{name}: {bend}");
        seen += 1;
    }
    assert!(seen > 15, "{seen}");
    for model in Model::ALL {
        let yields = [
            Model::Linear,
            Model::Corotational,
            Model::WarpedStiffness,
            Model::MassSpring,
            Model::QuadraticSprings,
        ];
        assert_eq!(model.holds_pressure(), !yields.contains(&model), "{model:?}");
        let soft = [Model::StVK, Model::CompressibleStVK, Model::StVKFem];
        assert_eq!(model.softens(), soft.contains(&model), "{model:?}");
    }
}

/// Elements of every row can be found by its mark.
#[test]
fn marks_find_elements() {
    let mesh = tetrahedra();
    let mut world = empty::<f64>();
    for (i, model) in Model::ALL.into_iter().enumerate() {
        let name = format!("body {i}");
        spawn_body(
            &mut world,
            &BodyDescription { model, ..BodyDescription::new(&name, &mesh, MATERIAL) },
        )
        .unwrap();
    }
    for model in Model::ALL {
        let Some(law) = model.law() else { continue };
        let mark = law.mark::<f64>(&mut world);
        let count = QueryBuilder::<()>::new(&mut world).with_id(mark).build().iter(&world).count();
        let bodies = Model::ALL.into_iter().filter(|other| other.law() == Some(law)).count();
        assert_eq!(count, bodies * mesh.tetrahedra.len(), "{}", law.info.name);
    }
}
