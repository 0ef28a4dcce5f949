//! Every function once, with a number that would be wrong if it were.

use crate::{Slab, api::*, c, nil, ok, said, sized};
use sinew_embed::{
    BodyDescription, ConstraintSpec, Embedding, Options, mesh_from_generator, preset,
};
use std::ffi::CStr;
use std::ptr::{null, null_mut};

#[test]
fn steps_have_the_hash_of_the_library() {
    let slab = Slab::new(1);
    ok(unsafe { sinew_step(slab.sim, 25) });
    let mesh = mesh_from_generator("box = { size = [0.1, 0.1, 0.05], cells = [4, 4, 2] }").unwrap();
    let mut sim = Embedding::new(&Options { threads: 1, ..Options::default() }).unwrap();
    let description = BodyDescription::new("slab", &mesh, preset("liver").unwrap());
    let body = sim.add_body(&mesh, &description).unwrap();
    let floor = sim.group(body, "z0").unwrap();
    sim.add_constraint(body, &ConstraintSpec::hold("floor", &floor)).unwrap();
    sim.step(25).unwrap();
    assert_eq!(slab.hash(), sim.hash());
    assert_eq!(slab.read(SINEW_POSITIONS), sim.positions(body).unwrap().as_flattened());
    assert_eq!(slab.read(SINEW_DISPLACEMENTS), sim.displacements(body).unwrap().as_flattened());
    assert_eq!(slab.read(SINEW_VELOCITIES), sim.velocities(body).unwrap().as_flattened());
    assert_eq!(slab.read(SINEW_MASSES), sim.masses(body).unwrap());
    assert_eq!(slab.read(SINEW_VOLUME_RATIOS), sim.volume_ratios(body).unwrap());
    assert_eq!(slab.read(SINEW_ELASTIC_FORCES), sim.elastic_forces(body).unwrap().as_flattened());
    assert_eq!(slab.read(SINEW_EXTERNAL_FORCES), sim.external_forces(body).unwrap().as_flattened());
    assert_eq!(slab.read(SINEW_CONTACT_FORCES), vec![0.0; 3 * slab.vertices]);
    assert_eq!(slab.read(SINEW_CONTACT_PRESSURES), vec![0.0; slab.vertices]);
    assert!(slab.read(SINEW_AREA_RATIOS).is_empty());
    let (mut elastic, mut kinetic, mut seconds) = (0.0, 0.0, 0.0);
    let (mut force, mut torque) = ([0.0; 3], [0.0; 3]);
    let about = [0.1, 0.2, 0.3];
    unsafe {
        ok(sinew_energy(slab.sim, &mut elastic, &mut kinetic));
        ok(sinew_time(slab.sim, &mut seconds));
        ok(sinew_reaction(
            slab.sim,
            slab.hold,
            about.as_ptr(),
            force.as_mut_ptr(),
            torque.as_mut_ptr(),
        ));
        ok(sinew_reaction(slab.sim, slab.hold, null(), null_mut(), null_mut()));
    }
    let energy = sim.energy();
    assert_eq!((elastic, kinetic, seconds), (energy.elastic, energy.kinetic, sim.time()));
    let held = sim.find(sinew_embed::Kind::Constraint, "floor").unwrap();
    let wrench = sim.reaction(held, about).unwrap();
    assert_eq!((force, torque), (wrench.force, wrench.torque));
    let mut needed = 0;
    let mut json = Vec::new();
    unsafe {
        ok(sinew_report_json(slab.sim, null_mut(), 0, &mut needed));
        json.resize(needed, 0);
        ok(sinew_report_json(slab.sim, json.as_mut_ptr(), needed, &mut needed));
        assert_eq!(CStr::from_ptr(json.as_ptr()).to_str().unwrap(), sim.report_json());
        ok(sinew_warnings_json(slab.sim, null_mut(), 0, &mut needed));
        json.resize(needed, 0);
        ok(sinew_warnings_json(slab.sim, json.as_mut_ptr(), needed, &mut needed));
        let told = CStr::from_ptr(json.as_ptr()).to_str().unwrap();
        assert_eq!(told, sim.warnings_json());
        assert!(told.starts_with('[') && told.ends_with(']'), "{told}");
        ok(sinew_verdict(slab.sim, json.as_mut_ptr(), json.len(), &mut needed));
        assert_eq!((needed, json[0], sim.verdict()), (1, 0, None));
        assert_eq!(CStr::from_ptr(sinew_version()).to_str().unwrap(), sinew_embed::version());
        assert_eq!(sinew_abi_version(), SINEW_ABI);
        let mut padded = vec![-1f32; 5 * slab.vertices];
        ok(sinew_positions_f32(slab.sim, slab.body, padded.as_mut_ptr(), slab.vertices, 20));
        for (row, x) in padded.chunks(5).zip(sim.positions(body).unwrap()) {
            assert_eq!(row[..3], x.map(|x| x as f32));
            assert_eq!(row[3..], [-1.0; 2]);
        }
    }
}

#[test]
fn snapshots_go_back_in_memory_and_as_bytes() {
    let (slab, anew) = (Slab::new(1), Slab::new(2));
    let (mut start, mut read) = (null_mut(), null_mut());
    let (mut needed, mut late, mut seconds) = (0, 0, 0.0);
    unsafe {
        ok(sinew_step(slab.sim, 5));
        ok(sinew_snapshot_take(slab.sim, &mut start));
        ok(sinew_step(slab.sim, 20));
        let end = slab.hash();
        let top = [2u32, 5];
        let gone = c("gone");
        ok(sinew_hold(slab.sim, slab.body, gone.as_ptr(), top.as_ptr(), 2, &mut late));
        ok(sinew_snapshot_restore(slab.sim, start));
        // what was added since is gone, what was there is as it was
        assert_eq!(sinew_remove(slab.sim, late), SINEW_HANDLE);
        ok(sinew_reaction(slab.sim, slab.hold, null(), null_mut(), null_mut()));
        ok(sinew_time(slab.sim, &mut seconds));
        assert!((seconds - 0.05).abs() < 1e-15, "{seconds}");
        ok(sinew_step(slab.sim, 20));
        assert_eq!(slab.hash(), end);
        // as bytes into a simulation that was built by the same calls, with other threads
        ok(sinew_snapshot_to_bytes(start, null_mut(), 0, &mut needed));
        let mut bytes = vec![0; needed];
        ok(sinew_snapshot_to_bytes(start, bytes.as_mut_ptr(), needed, null_mut()));
        sinew_snapshot_free(start);
        ok(sinew_snapshot_from_bytes(bytes.as_ptr(), needed, &mut read));
        ok(sinew_snapshot_restore(anew.sim, read));
        sinew_snapshot_free(read);
        ok(sinew_step(anew.sim, 20));
        assert_eq!(anew.hash(), end);
    }
}

#[test]
fn settings_state_and_names_pass() {
    let slab = Slab::new(1);
    let n = slab.vertices;
    let (u, v) = (vec![1e-3; 3 * n], vec![0.5; 3 * n]);
    unsafe {
        ok(sinew_set_gravity(slab.sim, [0.0; 3].as_ptr()));
        ok(sinew_set_dt(slab.sim, 0.002));
        ok(sinew_set_solver(slab.sim, c("integrator = 'safe'").as_ptr()));
        ok(sinew_set_state(slab.sim, slab.body, u.as_ptr(), v.as_ptr(), n));
    }
    assert_eq!((slab.read(SINEW_DISPLACEMENTS), slab.read(SINEW_VELOCITIES)), (u, v));
    ok(unsafe { sinew_step(slab.sim, 1) });
    let (mut seconds, mut found, mut count) = (0.0, 0, 0);
    unsafe {
        ok(sinew_time(slab.sim, &mut seconds));
        ok(sinew_find(slab.sim, SINEW_CONSTRAINT, c("floor").as_ptr(), &mut found));
        ok(sinew_vertex_count(slab.sim, slab.body, &mut count));
    }
    assert_eq!((seconds, found, count), (0.002, slab.hold, n));
    assert_eq!(slab.read(SINEW_EXTERNAL_FORCES), vec![0.0; 3 * n]);
}

#[test]
fn constraints_loads_and_pressures_act() {
    let slab = Slab::new(1);
    let (sim, body) = (slab.sim, slab.body);
    let top = [2u32, 5, 8];
    let curve = [0.0, 0.0, 0.1, 1.0];
    let (lift, pull, air) = (c("lift"), c("load"), c("air"));
    let spec = sized!(sinew_constraint {
        motion: SINEW_TRANSLATE,
        name: lift.as_ptr(),
        vertices: top.as_ptr(),
        vertex_count: 3,
        axes: 4,
        translation: [9.0, 9.0, 0.01],
        curve: curve.as_ptr(),
        curve_count: 2,
    });
    let (mut moved, mut load, mut pressure, mut held) = (0, 0, 0, 0);
    let mut triangles = vec![0u32; 3000];
    let (mut needed, mut revision) = (0, 0);
    unsafe {
        ok(sinew_constraint_add(sim, body, &spec, &mut moved));
        ok(sinew_step(sim, 5));
        assert!((slab.read(SINEW_DISPLACEMENTS)[8] - 0.005).abs() < 1e-12);
        let refused = sinew_constraint_pose(sim, moved, [0.0; 3].as_ptr(), null(), null());
        assert_eq!(refused, SINEW_ARGUMENT);
        ok(sinew_remove(sim, moved));
        assert_eq!(sinew_remove(sim, moved), SINEW_HANDLE);
        let turn = [0.0, 0.0, 0.05f64.sin(), 0.05f64.cos()];
        ok(sinew_hold(sim, body, lift.as_ptr(), top.as_ptr(), 3, &mut held));
        let before = slab.read(SINEW_POSITIONS);
        ok(sinew_constraint_pose(sim, held, [0.0, 0.0, 0.001].as_ptr(), turn.as_ptr(), null()));
        ok(sinew_step(sim, 1));
        let after = slab.read(SINEW_POSITIONS);
        for &v in &top {
            let at = 3 * v as usize;
            let [x, y] = [before[at], before[at + 1]];
            let (sin, cos) = 0.1f64.sin_cos();
            assert!((after[at] - (cos * x - sin * y)).abs() < 1e-12);
            assert!((after[at + 2] - before[at + 2] - 0.001).abs() < 1e-12);
        }
        ok(sinew_remove(sim, held));
        ok(sinew_set_gravity(sim, [0.0; 3].as_ptr()));
        ok(sinew_load_add(
            sim,
            body,
            pull.as_ptr(),
            top.as_ptr(),
            3,
            [0.3, 0.0, 0.0].as_ptr(),
            1,
            &mut load,
        ));
        ok(sinew_step(sim, 1));
        let external = slab.read(SINEW_EXTERNAL_FORCES);
        assert!((external[6] - 0.1).abs() < 1e-12 && external[0] == 0.0);
        ok(sinew_remove(sim, load));
        let down = [0.0, 0.0, -30.0];
        ok(sinew_traction_add(sim, body, pull.as_ptr(), null(), 0, 3, down.as_ptr(), &mut load));
        ok(sinew_step(sim, 1));
        let external = slab.read(SINEW_EXTERNAL_FORCES);
        let total: f64 = external.iter().skip(2).step_by(3).sum();
        ok(sinew_remove(sim, load));
        ok(sinew_surface(sim, body, triangles.as_mut_ptr(), 3000, &mut needed, &mut revision));
        // part by part it is the same
        let part = [triangles.as_ptr(), triangles[3..].as_ptr()];
        let mut halves = [0; 2];
        for (i, count) in [1, needed / 3 - 1].into_iter().enumerate() {
            let name = c(["first", "others"][i]);
            let (name, down) = (name.as_ptr(), down.as_ptr());
            ok(sinew_traction_add(sim, body, name, part[i], count, 3, down, &mut halves[i]));
        }
        ok(sinew_step(sim, 1));
        let external = slab.read(SINEW_EXTERNAL_FORCES);
        let again: f64 = external.iter().skip(2).step_by(3).sum();
        assert!(total < 0.0 && (again / total - 1.0).abs() < 1e-12, "{total} {again}");
        halves.into_iter().for_each(|half| ok(sinew_remove(sim, half)));
        let five =
            sinew_traction_add(sim, body, pull.as_ptr(), part[0], 1, 5, down.as_ptr(), &mut load);
        assert_eq!(five, SINEW_ARGUMENT);
        ok(sinew_surface(sim, body, triangles.as_mut_ptr(), 3000, &mut needed, &mut revision));
        assert_eq!(needed % 3, 0);
        ok(sinew_pressure_add(
            sim,
            body,
            air.as_ptr(),
            triangles.as_ptr(),
            needed / 3,
            200.0,
            &mut pressure,
        ));
        ok(sinew_set_solver(sim, c("mass_damping = 100").as_ptr()));
        ok(sinew_step(sim, 60));
        // positive pressure on outward triangles pulls everything outward
        let ratios = slab.read(SINEW_VOLUME_RATIOS);
        assert!(ratios.iter().sum::<f64>() > 1.003 * ratios.len() as f64, "{ratios:?}");
        let region =
            sized!(sinew_region { kind: SINEW_LIST, list: [0u32, 1].as_ptr(), list_count: 2 });
        let mut removed = 0;
        ok(sinew_remove_elements(sim, body, &region, &mut removed));
        assert_eq!(removed, 2);
        let before = revision;
        ok(sinew_surface(sim, body, null_mut(), 0, &mut needed, &mut revision));
        assert_eq!(revision, before + 1);
        let liver = c("liver");
        let stiff = sized!(sinew_material { preset: liver.as_ptr(), young_modulus: 1e5 });
        let (mut elastic, mut after) = (0.0, 0.0);
        ok(sinew_energy(sim, &mut elastic, null_mut()));
        ok(sinew_set_material(sim, body, &stiff));
        ok(sinew_energy(sim, &mut after, null_mut()));
        let ratio = 1e5 / preset("liver").unwrap().young_modulus;
        assert!((after / elastic / ratio - 1.0).abs() < 0.2, "{after} {elastic}");
    }
}

#[test]
fn tools_contacts_and_pulls_are_felt() {
    let slab = Slab::new(1);
    let (sim, body) = (slab.sim, slab.body);
    let (ball, second, pair, mouse) = (c("ball"), c("second"), c("pair"), c("mouse"));
    let parts = [
        sized!(sinew_part { shape: SINEW_SPHERE, radius: 0.02 }),
        sized!(sinew_part {
            shape: SINEW_BOX,
            half: [0.01; 3],
            rounding: 0.002,
            at: [0.0, 0.0, 0.1]
        }),
        sized!(sinew_part { shape: SINEW_CLOSED_MESH, mesh: slab.mesh, at: [0.0, 0.0, 0.5] }),
    ];
    let tool = sized!(sinew_tool {
        flags: SINEW_LOCAL_STIFFNESS | SINEW_ERROR_BAR,
        name: ball.as_ptr(),
        parts: parts.as_ptr(),
        part_count: 3,
        position: [0.05, 0.05, 0.08],
        friction: 0.2,
    });
    let (mut handle, mut other, mut contact, mut pull) = (0, 0, 0, 0);
    let mut report = sized!(sinew_tool_report {});
    let mut felt = [crate::blank::<sinew_part_report>(); 3];
    let mut pick = sized!(sinew_pick_result {});
    let (mut force, mut length, mut needed) = ([0.0; 3], 0.0, 0);
    unsafe {
        ok(sinew_tool_add(sim, &tool, &mut handle));
        for i in 1..=60 {
            let at = [0.05, 0.05, 0.08 - 0.0003 * f64::from(i)];
            ok(sinew_tool_move(sim, handle, at.as_ptr(), null(), 0.0, 0));
            ok(sinew_step(sim, 1));
        }
        ok(sinew_read_tool_report(sim, handle, &mut report));
        assert!(report.force[2] > 0.05 && report.depth > 0.0 && report.local_stiffness[8] != 0.0);
        assert!((report.position[2] - 0.062).abs() < 1e-12);
        // 0.3 mm in a step of 10 ms
        assert!((report.velocity[2] + 0.03).abs() < 1e-12 && report.angular_velocity == [0.0; 3]);
        assert!(report.energy > 0.0 && report.drawn_in == 0.0);
        let (own, others) = (report.force[2], report.other_points[2]);
        assert!(others > 0.2 * own && others < 5.0 * own && others != own, "{own} {others}");
        ok(sinew_tool_parts(sim, handle, felt.as_mut_ptr(), 3, &mut needed));
        assert_eq!((needed, report.parts, felt[1].force), (3, 3, [0.0; 3]));
        assert_eq!(felt[0].force, report.force);
        let pushed: f64 = slab.read(SINEW_CONTACT_FORCES).chunks(3).map(|f| f[2]).sum();
        assert!((pushed + report.force[2]).abs() < 1e-9 * pushed.abs());
        ok(sinew_tool_grip(sim, handle, 1));
        ok(sinew_tool_move(sim, handle, [0.0, 0.0, 9.0].as_ptr(), null(), 0.0, 1));
        ok(sinew_step(sim, 1));
        ok(sinew_read_tool_report(sim, handle, &mut report));
        assert_eq!(report.force, [0.0; 3]);

        // a room that the slab fits in, wherever it may go
        let hall = sized!(sinew_part { shape: SINEW_SPHERE, radius: 9.0 });
        let room = c("room");
        let mut hollow = sized!(sinew_tool {
            flags: SINEW_CAVITY,
            name: room.as_ptr(),
            parts: &hall,
            part_count: 1,
        });
        ok(sinew_tool_add(sim, &hollow, &mut other));
        ok(sinew_step(sim, 1));
        ok(sinew_read_tool_report(sim, other, &mut report));
        assert_eq!((report.force, report.drawn_in), ([0.0; 3], 0.0));
        let floor = sized!(sinew_part { shape: SINEW_HALF_SPACE });
        hollow.parts = &floor;
        assert_ne!(sinew_tool_add(sim, &hollow, &mut other), SINEW_OK);

        ok(sinew_pick(sim, [0.05, 0.04, 1.0].as_ptr(), [0.0, 0.0, -1.0].as_ptr(), &mut pick));
        assert_eq!((pick.hit, pick.body), (1, body));
        let hand = sized!(sinew_pull {
            name: mouse.as_ptr(),
            vertices: pick.vertices.as_ptr(),
            vertex_count: 3,
            weights: pick.weights.as_ptr(),
            stiffness: 30.0,
            damping: 0.1,
        });
        ok(sinew_pull_add(sim, body, &hand, &mut pull));
        ok(sinew_pull_move(sim, pull, [0.0, 0.0, 0.01].as_ptr(), null(), null()));
        ok(sinew_step(sim, 60));
        ok(sinew_pull_force(sim, pull, force.as_mut_ptr(), &mut length));
        let size = force.iter().map(|f| f * f).sum::<f64>().sqrt();
        assert!((size / length / 30.0 - 1.0).abs() < 0.1, "{force:?} {length}");
        ok(sinew_pick(sim, [0.05, 0.04, 1.0].as_ptr(), [0.0, 0.0, 1.0].as_ptr(), &mut pick));
        assert_eq!(pick.hit, 0);
        ok(sinew_remove(sim, pull));

        let liver = c("liver");
        let material = sized!(sinew_material { preset: liver.as_ptr() });
        let described = sized!(sinew_body { name: second.as_ptr(), material: &material });
        ok(sinew_body_add(sim, slab.mesh, &described, &mut other));
        ok(sinew_contact_add(sim, pair.as_ptr(), body, other, 0.0, &mut contact));
        let mut lifted = vec![0.0; 3 * slab.vertices];
        lifted.iter_mut().skip(2).step_by(3).for_each(|z| *z = 0.0505);
        let still = vec![0.0; 3 * slab.vertices];
        ok(sinew_set_state(sim, other, lifted.as_ptr(), still.as_ptr(), slab.vertices));
        ok(sinew_step(sim, 30));
        ok(sinew_contact_force(sim, contact, force.as_mut_ptr(), &mut length));
        assert!(force[2] < -0.1 && length > 0.0, "{force:?} {length}");
    }
}

#[test]
fn bodies_of_all_kinds_are_made() {
    let slab = Slab::new(1);
    let (names, liver) = ([c("m"), c("f"), c("s"), c("h")], c("liver"));
    let material = sized!(sinew_material { preset: liver.as_ptr() });
    let (mut handle, mut sheet) = (0, null_mut());
    unsafe {
        // the boundary of a solid as membrane
        let skin = sized!(sinew_membrane { surface: 1, thickness: 1e-3, model: nil() });
        let body =
            sized!(sinew_body { name: names[0].as_ptr(), material: &material, membrane: &skin });
        ok(sinew_body_add(slab.sim, slab.mesh, &body, &mut handle));
        let mut needed = 0;
        ok(sinew_read(slab.sim, handle, SINEW_AREA_RATIOS, null_mut(), 0, &mut needed));
        let mut surface = 0;
        ok(sinew_surface(slab.sim, handle, null_mut(), 0, &mut surface, null_mut()));
        assert_eq!(3 * needed, surface);
        // active fibres
        let muscle = sized!(sinew_muscle { peak_stress: 2e3 });
        let family = c("m");
        let fibre = sized!(sinew_fibre {
            name: family.as_ptr(),
            directions: [0.0, 0.0, 1.0].as_ptr(),
            direction_count: 1,
            modulus: 1e3,
            muscle: &muscle,
        });
        let body = sized!(sinew_body {
            name: names[1].as_ptr(),
            material: &material,
            fibres: &fibre,
            fibre_count: 1,
        });
        ok(sinew_body_add(slab.sim, slab.mesh, &body, &mut handle));
        ok(sinew_set_activation(slab.sim, handle, family.as_ptr(), 1.0));
        ok(sinew_set_gravity(slab.sim, [0.0; 3].as_ptr()));
        ok(sinew_step(slab.sim, 3));
        let mut x = vec![0.0; 3 * slab.vertices];
        ok(sinew_read(slab.sim, handle, SINEW_DISPLACEMENTS, x.as_mut_ptr(), x.len(), null_mut()));
        assert!(x[8] < x[2] - 1e-4, "it shortens: {} {}", x[2], x[8]);
        // springs, another model, another way to sum
        let (springs, method) = (c("mass_spring"), c("uniform"));
        let body = sized!(sinew_body {
            name: names[2].as_ptr(),
            material: &material,
            model: springs.as_ptr(),
            springs: method.as_ptr(),
            spring_constant: 10.0,
        });
        ok(sinew_body_add(slab.sim, slab.mesh, &body, &mut handle));
        // a list by element of the wrong length
        let wrong = sized!(sinew_material {
            preset: liver.as_ptr(),
            young_moduli: [1e3, 1e3].as_ptr(),
            element_count: 2,
        });
        let body = sized!(sinew_body { name: names[3].as_ptr(), material: &wrong });
        assert_eq!(sinew_body_add(slab.sim, slab.mesh, &body, &mut handle), SINEW_MATERIAL);
        assert!(said().contains("body `h`"), "{}", said());
        // from bytes
        let name = c("skin.obj");
        let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        ok(sinew_mesh_from_bytes(name.as_ptr(), text.as_ptr(), text.len(), &mut sheet));
        let whole = sized!(sinew_membrane { thickness: 1e-3 });
        let body =
            sized!(sinew_body { name: names[3].as_ptr(), material: &material, membrane: &whole });
        ok(sinew_body_add(slab.sim, sheet, &body, &mut handle));
        sinew_mesh_free(sheet);
    }
}

/// What a list function gives, asked for twice.
fn listed<T: Clone + Default>(mut call: impl FnMut(*mut T, usize, *mut usize) -> i32) -> Vec<T> {
    let mut needed = 0;
    ok(call(null_mut(), 0, &mut needed));
    let mut all = vec![T::default(); needed];
    ok(call(all.as_mut_ptr(), needed, &mut needed));
    all
}

#[test]
fn meshes_show_what_they_hold() {
    let text =
        b"# vtk DataFile Version 2.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n\
        0 0 0 1 0 0 0 1 0 0 0 1 1 1 1\nCELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 2\n10\n10\n\
        CELL_DATA 2\nFIELD f 2\nE 1 2 double\n5e3 3e4\nhard 1 2 int\n0 1\n";
    let name = c("two.vtk");
    let mut mesh = null_mut();
    unsafe {
        ok(sinew_mesh_from_bytes(name.as_ptr(), text.as_ptr(), text.len(), &mut mesh));
        let points = listed(|out, capacity, needed| sinew_mesh_points(mesh, out, capacity, needed));
        assert_eq!((points.len(), points[14]), (15, 1.0));
        let cells = |kind| {
            listed(|out, capacity, needed| sinew_mesh_cells(mesh, kind, out, capacity, needed))
        };
        assert_eq!(cells(SINEW_TETRAHEDRA), [0, 1, 2, 3, 1, 2, 3, 4]);
        assert!(cells(SINEW_QUADS).is_empty());
        let (stiffness, hard) = (c("E"), c("hard"));
        let data = listed(|out, capacity, needed| {
            sinew_mesh_cell_data(mesh, stiffness.as_ptr(), out, capacity, needed)
        });
        assert_eq!(data, [5e3, 3e4]);
        let group = listed(|out, capacity, needed| {
            sinew_mesh_group(mesh, hard.as_ptr(), out, capacity, needed)
        });
        assert_eq!(group, [1, 2, 3, 4]);
        let place = c("half_space = { point = [0, 0, 0.5], normal = [0, 0, 1] }");
        let above = listed(|out, capacity, needed| {
            sinew_mesh_select(mesh, place.as_ptr(), out, capacity, needed)
        });
        assert_eq!(above, [3, 4]);
        let json =
            listed(|out, capacity, needed| sinew_mesh_info_json(mesh, out, capacity, needed));
        let json = CStr::from_ptr(json.as_ptr()).to_str().unwrap();
        assert!(json.contains("\"name\":\"E\",\"integer\":false,\"cells\":2"), "{json}");
        // what is not there is told
        let mut needed = 0;
        let of = |code, words: &str| {
            assert!(code == SINEW_ARGUMENT && said().contains(words), "{}", said())
        };
        of(sinew_mesh_cell_data(mesh, hard.as_ptr().add(1), null_mut(), 0, &mut needed), "`ard`");
        of(sinew_mesh_cells(mesh, 9, null_mut(), 0, &mut needed), "9 is none");
        let place = c("sphere = { centre = [9, 9, 9], radius = 1 }");
        of(
            sinew_mesh_select(mesh, place.as_ptr(), null_mut(), 0, &mut needed),
            "no vertex is there",
        );
        let place = c("patch = { angle = 20 }");
        of(sinew_mesh_select(mesh, place.as_ptr(), null_mut(), 0, &mut needed), "`normal` or both");
        sinew_mesh_free(mesh);
    }
}

#[test]
fn scenes_come_from_files_and_from_memory() {
    let path = sinew_embed_scene("liver_resection");
    let text = std::fs::read_to_string(&path).unwrap();
    let folder = std::path::Path::new(&path).parent().unwrap();
    let (mut first, mut second) = (null_mut(), null_mut());
    let (mut one, mut two) = (0, 0);
    let named: Vec<&str> = text
        .lines()
        .filter_map(|line| line.trim().strip_prefix("mesh = \"")?.strip_suffix('"'))
        .collect();
    let bytes: Vec<Vec<u8>> =
        named.iter().map(|name| std::fs::read(folder.join(name)).unwrap()).collect();
    let names: Vec<_> = named.iter().map(|name| c(name)).collect();
    let files: Vec<sinew_file> = names
        .iter()
        .zip(&bytes)
        .map(|(name, bytes)| sinew_file {
            name: name.as_ptr(),
            bytes: bytes.as_ptr(),
            size: bytes.len(),
        })
        .collect();
    assert!(!files.is_empty());
    unsafe {
        ok(sinew_simulation_from_scene(c(&path).as_ptr(), 1, &mut first));
        let (toml, name) = (c(&text), c("liver_resection.toml"));
        ok(sinew_simulation_from_text(
            toml.as_ptr(),
            name.as_ptr(),
            files.as_ptr(),
            files.len(),
            1,
            &mut second,
        ));
        for (sim, hash) in [(first, &mut one), (second, &mut two)] {
            ok(sinew_step(sim, 5));
            ok(sinew_hash(sim, hash));
            sinew_simulation_free(sim);
        }
    }
    assert_eq!(one, two);
}

fn sinew_embed_scene(name: &str) -> String {
    format!("{}/../../demos/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn a_body_is_cut_and_drawn() {
    let slab = Slab::new(1);
    let (name, liver) = (c("other"), c("liver"));
    let material = sized!(sinew_material { preset: liver.as_ptr() });
    let strip =
        [[0.045, -0.01, 0.06, 0.045, -0.01, -0.01], [0.045, 0.11, 0.06, 0.045, 0.11, -0.01]];
    let strip = strip.as_flattened().as_ptr();
    let described = sized!(sinew_body {
        name: name.as_ptr(),
        material: &material,
        spare: slab.vertices,
        glue: 5.0
    });
    let (mut body, mut needed, mut revision) = (0, 0, [0; 2]);
    let mut report = sized!(sinew_cut_report {});
    unsafe {
        let sim = slab.sim;
        assert_eq!(sinew_cut(sim, slab.body, strip, 2, null_mut()), SINEW_ARGUMENT);
        assert!(said().contains("spare"), "{}", said());
        ok(sinew_body_add(sim, slab.mesh, &described, &mut body));
        ok(sinew_skin_triangles(sim, body, null_mut(), 0, &mut needed, &mut revision[0]));
        ok(sinew_cut(sim, body, strip, 2, &mut report));
        assert_eq!(report.pieces, 2);
        assert!(
            (report.area - 0.005).abs() < 1e-9 && report.vertices + report.spare == slab.vertices
        );
        ok(sinew_skin_triangles(sim, body, null_mut(), 0, &mut needed, &mut revision[1]));
        assert!(revision[1] > revision[0]);
        // the blade passed all of its glue
        let mut glue = [7.0; 3];
        ok(sinew_read(sim, body, SINEW_GLUE, glue.as_mut_ptr(), 3, null_mut()));
        assert_eq!(glue, [0.0; 3]);
        let none = sinew_read(sim, slab.body, SINEW_GLUE, glue.as_mut_ptr(), 3, null_mut());
        assert_eq!(none, SINEW_ARGUMENT);
        assert!(said().contains("no glue"), "{}", said());
        let mut triangles = vec![0; needed];
        let list = triangles.as_mut_ptr();
        ok(sinew_skin_triangles(sim, body, list, needed, &mut needed, null_mut()));
        let mut wound = vec![7; needed / 3];
        ok(sinew_skin_wound(sim, body, wound.as_mut_ptr(), needed / 3, &mut needed));
        let mut read = |quantity| {
            ok(sinew_skin_read(sim, body, quantity, null_mut(), 0, &mut needed));
            let mut numbers = vec![f64::NAN; needed];
            ok(sinew_skin_read(sim, body, quantity, numbers.as_mut_ptr(), needed, &mut needed));
            numbers
        };
        let (points, rest) = (read(SINEW_SKIN_POINTS), read(SINEW_SKIN_REST));
        let depth = read(SINEW_SKIN_DEPTH);
        assert!(points == rest && points.len() == 3 * depth.len() && depth.len() > slab.vertices);
        assert!(wound.contains(&1) && wound.iter().all(|own| *own < 2));
        for (t, _) in triangles.chunks(3).zip(&wound).filter(|(_, wound)| **wound == 1) {
            assert!(t.iter().all(|&v| (points[3 * v as usize] - 0.045).abs() < 1e-12));
        }
    }
}

#[test]
fn blades_needles_threads_and_tears_are_there() {
    let slab = Slab::new(1);
    let [name, liver, floor] = [c("other"), c("liver"), c("other-floor")];
    let material = sized!(sinew_material { preset: liver.as_ptr() });
    let described =
        sized!(sinew_body { name: name.as_ptr(), material: &material, spare: 4 * slab.vertices });
    let (sim, mut body, mut tool, mut pin, mut parts) = (slab.sim, 0, 0, 0, [7; 2]);
    let edge =
        c("ends = [[0.0, 0.0, 0.06], [0.0, 0.0, 0.02]]\ninto = [0.0, 1.0, 0.0]\ntoughness = 50.0");
    let needle =
        c("into = [0, 0, -1]\nlength = 0.1\ndiameter = 1e-3\ntoughness = 20.0\nfriction = 1.0");
    let read = |handle, quantity| {
        let mut needed = 0;
        unsafe {
            ok(sinew_read(sim, handle, quantity, null_mut(), 0, &mut needed));
            let mut numbers = vec![f64::NAN; needed];
            ok(sinew_read(sim, handle, quantity, numbers.as_mut_ptr(), needed, null_mut()));
            numbers
        }
    };
    unsafe {
        let at = slab.read(SINEW_POSITIONS);
        let group: Vec<u32> = (0..75).filter(|&v| at[3 * v as usize + 2] == 0.0).collect();
        ok(sinew_remove(sim, slab.body));
        ok(sinew_body_add(sim, slab.mesh, &described, &mut body));
        ok(sinew_hold(sim, body, floor.as_ptr(), group.as_ptr(), 25, &mut 0));
        let go = |tool, at: &dyn Fn(f64) -> [f64; 3], steps| {
            for step in 1..=steps {
                ok(sinew_tool_move(sim, tool, at(f64::from(step)).as_ptr(), null(), 0.0, 0));
                ok(sinew_step(sim, 1));
            }
            let mut report = sized!(sinew_tool_report {});
            ok(sinew_read_tool_report(sim, tool, &mut report));
            report
        };
        // an edge cuts into it from above, against its toughness
        let at = |way: f64| [0.045, 2.5e-3 * way - 0.005, 0.0];
        let own =
            sized!(sinew_tool { name: name.as_ptr(), edge: edge.as_ptr(), position: at(0.0) });
        ok(sinew_tool_add(sim, &own, &mut tool));
        let cut = go(tool, &at, 60);
        assert!(cut.separated > 0 && cut.cut_vertices > 0 && cut.cut_area > 1e-3);
        assert!((cut.fracture / cut.cut_area / 50.0 - 1.0).abs() < 1e-9);
        ok(sinew_remove(sim, tool));
        // a needle goes down beside the wound, and a thread takes its place
        let at = |way: f64| [0.071, 0.052, 0.051 - 1e-3 * way];
        let own =
            sized!(sinew_tool { name: name.as_ptr(), needle: needle.as_ptr(), position: at(0.0) });
        ok(sinew_tool_add(sim, &own, &mut pin));
        let felt = go(pin, &at, 30);
        assert!(felt.punctures == 1 && felt.inserted > 0.02, "{}", felt.inserted);
        let point = |of, at| sinew_thread_point { of, at };
        let [left, right] = [0.03, 0.06].map(|x| point(body, [x, 0.05, 0.04]));
        let through = [left, point(pin, [0.0; 3]), point(0, [0.06, 0.05, 0.08])];
        let lay = |kind, lines: &str, points: &[sinew_thread_point]| {
            let (lines, mut made) = (c(lines), 0);
            let (list, count) = (points.as_ptr(), points.len());
            (sinew_thread_add(sim, kind, lines.as_ptr(), list, count, &mut made), made)
        };
        let lines = "name = \"stitch\"\nstiffness = 20.0";
        for (kind, lines, points, why) in [
            (SINEW_THREAD, lines, 1, "two points at least"),
            (SINEW_THREAD, "name = \"stitch\"\nstifness = 20.0", 3, "stifness"),
            (SINEW_TOOL, lines, 3, "no thread or clip"),
            (SINEW_CLIP, lines, 3, "two points"),
        ] {
            let refused = (SINEW_ARGUMENT, 0);
            assert_eq!(lay(kind, lines, &through[..points]), refused);
            assert!(said().contains(why), "{}", said());
        }
        let (status, stitch) = lay(SINEW_THREAD, lines, &through);
        ok(status);
        let (status, clip) = lay(SINEW_CLIP, "name = \"clip\"\nstiffness = 5.0", &[left, right]);
        ok(status);
        ok(sinew_remove(sim, pin));
        ok(sinew_step(sim, 1));
        let last = read(stitch, SINEW_THREAD_HELD).len() - 1;
        for step in 1..=10 {
            ok(sinew_thread_draw(sim, stitch, 1, 1e-3 * f64::from(step)));
            ok(sinew_thread_move(sim, stitch, last as u32, [0.06, 0.05, 0.081].as_ptr()));
            ok(sinew_step(sim, 1));
        }
        let report = read(stitch, SINEW_THREAD_REPORT);
        let tension = read(stitch, SINEW_THREAD_TENSIONS);
        assert_eq!((report.len(), report[4]), (7, 0.0));
        assert!(report[0] > 0.01 && report[2] > 0.0, "{report:?}");
        assert_eq!(report[0], tension.iter().copied().fold(0.0, f64::max));
        assert_eq!(report[1], read(stitch, SINEW_THREAD_SPANS).iter().sum::<f64>());
        let counts = [SINEW_THREAD_POINTS, SINEW_THREAD_FREE, SINEW_THREAD_SLID, SINEW_THREAD_ENDS];
        let counts = counts.map(|of| read(stitch, of).len());
        assert_eq!(counts, [3 * (last + 1), last, last + 1, 6]);
        assert!(read(clip, SINEW_THREAD_TENSIONS)[0] > 0.0);
        ok(sinew_thread_tie(sim, stitch));
        ok(sinew_step(sim, 1));
        let [first, second] = &mut parts;
        ok(sinew_thread_cut(sim, stitch, 0, first, second));
        assert!(parts[0] == 0 && parts[1] == stitch, "{parts:?}");
        // and it tears
        assert_eq!(sinew_read(sim, body, SINEW_TEAR, null_mut(), 0, null_mut()), SINEW_ARGUMENT);
        assert!(said().contains("does not tear"), "{}", said());
        assert_eq!(sinew_tear_set(sim, body, c("strength = -1.0").as_ptr()), SINEW_ARGUMENT);
        ok(sinew_tear_set(sim, body, c("strength = 10.0").as_ptr()));
        ok(sinew_step(sim, 5));
        let tear = read(body, SINEW_TEAR);
        assert!(tear.len() == 8 && tear[0] > 0.0 && tear[1] > 0.0, "{tear:?}");
        ok(sinew_tear_set(sim, body, null()));
        assert_eq!(sinew_read(sim, body, SINEW_TEAR, null_mut(), 0, null_mut()), SINEW_ARGUMENT);
    }
}
