//! NULL, nothing, wrong handles, wrong sizes, panics, several threads: codes and texts, never a crash.

use crate::{Slab, api::*, c, header, ok, said, sized};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicU32, Ordering};

/// Calls of a table: name, status.
macro_rules! calls {
    ($table:ident: $($function:ident($($argument:expr),* $(,)?);)*) => {$(
        $table.push((stringify!($function), unsafe { $function($($argument),*) }));
    )*};
}

#[test]
#[allow(clippy::too_many_lines, reason = "a table of all functions")]
fn null_is_an_argument_everywhere() {
    let slab = Slab::new(1);
    let (sim, body) = (slab.sim, slab.body);
    let none: *mut sinew_simulation = null_mut();
    let mut table = Vec::new();
    calls! { table:
        sinew_simulation_new(null(), null_mut());
        sinew_simulation_from_scene(null(), 0, null_mut());
        sinew_simulation_from_text(null(), null(), null(), 0, 0, null_mut());
        sinew_mesh_from_file(null(), null_mut());
        sinew_mesh_from_bytes(null(), null(), 0, null_mut());
        sinew_mesh_from_arrays(null(), null_mut());
        sinew_mesh_info_json(null(), null_mut(), 0, null_mut());
        sinew_mesh_points(null(), null_mut(), 0, null_mut());
        sinew_mesh_cells(null(), 0, null_mut(), 0, null_mut());
        sinew_mesh_group(null(), null(), null_mut(), 0, null_mut());
        sinew_mesh_group(slab.mesh, null(), null_mut(), 0, null_mut());
        sinew_mesh_cell_data(null(), null(), null_mut(), 0, null_mut());
        sinew_mesh_cell_data(slab.mesh, null(), null_mut(), 0, null_mut());
        sinew_mesh_select(null(), null(), null_mut(), 0, null_mut());
        sinew_mesh_select(slab.mesh, null(), null_mut(), 0, null_mut());
        sinew_step(none, 1);
        sinew_time(none, null_mut());
        sinew_time(sim, null_mut());
        sinew_set_dt(none, 0.1);
        sinew_set_gravity(none, null());
        sinew_set_gravity(sim, null());
        sinew_set_solver(none, null());
        sinew_set_solver(sim, null());
        sinew_find(none, 1, null(), null_mut());
        sinew_find(sim, 1, null(), null_mut());
        sinew_remove(none, 0);
        sinew_body_add(none, null(), null(), null_mut());
        sinew_body_add(sim, null(), null(), null_mut());
        sinew_body_add(sim, slab.mesh, null(), null_mut());
        sinew_vertex_count(none, 0, null_mut());
        sinew_vertex_count(sim, body, null_mut());
        sinew_group_vertices(none, 0, null(), null_mut(), 0, null_mut());
        sinew_group_vertices(sim, body, null(), null_mut(), 0, null_mut());
        sinew_read(none, 0, 0, null_mut(), 0, null_mut());
        sinew_read(sim, body, 0, null_mut(), 0, null_mut());
        sinew_read(sim, body, 0, null_mut(), 1 << 40, null_mut());
        sinew_positions_f32(none, 0, null_mut(), 0, 12);
        sinew_positions_f32(sim, body, null_mut(), slab.vertices, 12);
        sinew_set_state(none, 0, null(), null(), 0);
        sinew_set_state(sim, body, null(), null(), slab.vertices);
        sinew_surface(none, 0, null_mut(), 0, null_mut(), null_mut());
        sinew_surface(sim, body, null_mut(), 0, null_mut(), null_mut());
        sinew_set_material(none, 0, null());
        sinew_set_material(sim, body, null());
        sinew_set_activation(none, 0, null(), 0.5);
        sinew_set_activation(sim, body, null(), 0.5);
        sinew_remove_elements(none, 0, null(), null_mut());
        sinew_remove_elements(sim, body, null(), null_mut());
        sinew_cut(none, 0, null(), 0, null_mut());
        sinew_cut(sim, body, null(), 2, null_mut());
        sinew_skin_read(none, 0, 0, null_mut(), 0, null_mut());
        sinew_skin_read(sim, body, 7, null_mut(), 0, null_mut());
        sinew_skin_triangles(none, 0, null_mut(), 0, null_mut(), null_mut());
        sinew_skin_triangles(sim, body, null_mut(), 0, null_mut(), null_mut());
        sinew_skin_wound(none, 0, null_mut(), 0, null_mut());
        sinew_skin_wound(sim, body, null_mut(), 0, null_mut());
        sinew_hold(none, 0, null(), null(), 0, null_mut());
        sinew_hold(sim, body, null(), null(), 3, null_mut());
        sinew_constraint_add(none, 0, null(), null_mut());
        sinew_constraint_add(sim, body, null(), null_mut());
        sinew_constraint_pose(none, 0, null(), null(), null());
        sinew_reaction(none, 0, null(), null_mut(), null_mut());
        sinew_load_add(none, 0, null(), null(), 0, null(), 0, null_mut());
        sinew_load_add(sim, body, null(), null(), 1, null(), 1, null_mut());
        sinew_pressure_add(none, 0, null(), null(), 0, 1.0, null_mut());
        sinew_pressure_add(sim, body, null(), null(), 1, 1.0, null_mut());
        sinew_traction_add(none, 0, null(), null(), 0, 3, null(), null_mut());
        sinew_traction_add(sim, body, null(), null(), 1, 3, null(), null_mut());
        sinew_traction_add(sim, body, null(), null(), usize::MAX, 4, null(), null_mut());
        sinew_tool_add(none, null(), null_mut());
        sinew_tool_add(sim, null(), null_mut());
        sinew_tool_move(none, 0, null(), null(), 0.0, 0);
        sinew_tool_move(sim, 0, null(), null(), 0.0, 0);
        sinew_tool_grip(none, 0, 1);
        sinew_read_tool_report(none, 0, null_mut());
        sinew_read_tool_report(sim, 0, null_mut());
        sinew_tool_parts(none, 0, null_mut(), 0, null_mut());
        sinew_contact_add(none, null(), 0, 0, 0.0, null_mut());
        sinew_contact_add(sim, null(), 0, 0, 0.0, null_mut());
        sinew_contact_force(none, 0, null_mut(), null_mut());
        sinew_pull_add(none, 0, null(), null_mut());
        sinew_pull_add(sim, body, null(), null_mut());
        sinew_pull_move(none, 0, null(), null(), null());
        sinew_pull_force(none, 0, null_mut(), null_mut());
        sinew_thread_add(none, SINEW_THREAD, null(), null(), 0, null_mut());
        sinew_thread_add(sim, SINEW_CLIP, null(), null(), 0, null_mut());
        sinew_thread_move(none, 0, 0, null());
        sinew_thread_move(sim, 0, 0, null());
        sinew_thread_draw(none, 0, 0, 0.0);
        sinew_thread_hold(none, 0, 0);
        sinew_thread_tie(none, 0);
        sinew_thread_cut(none, 0, 0, null_mut(), null_mut());
        sinew_thread_cut(sim, 0, 0, null_mut(), null_mut());
        sinew_tear_set(none, 0, null());
        sinew_haptic_add(none, 0, null(), null_mut(), null_mut());
        sinew_haptic_add(sim, body, null(), null_mut(), null_mut());
        sinew_haptic_release(none, 0);
        sinew_haptic_exchange(null(), null(), null(), 0.001, null_mut());
        sinew_haptic_exchange_pose(null(), null(), null(), null(), null(), 0.001, null_mut());
        sinew_live_share(none, null(), 0, null(), 0, null_mut());
        sinew_live_share(sim, null(), 0, null(), 0, null_mut());
        sinew_live_share(sim, null(), 1, null(), 0, null_mut());
        sinew_live_update(null_mut(), null_mut(), null_mut(), null_mut());
        sinew_live_read(null_mut(), body, 0, 0.0, null_mut(), 0, null_mut());
        sinew_pick(none, null(), null(), null_mut());
        sinew_pick(sim, null(), null(), null_mut());
        sinew_report_json(none, null_mut(), 0, null_mut());
        sinew_warnings_json(none, null_mut(), 0, null_mut());
        sinew_verdict(none, null_mut(), 0, null_mut());
        sinew_report_json(sim, null_mut(), 0, null_mut());
        sinew_warnings_json(sim, null_mut(), 0, null_mut());
        sinew_verdict(sim, null_mut(), 0, null_mut());
        sinew_energy(none, null_mut(), null_mut());
        sinew_hash(none, null_mut());
        sinew_hash(sim, null_mut());
        sinew_snapshot_take(none, null_mut());
        sinew_snapshot_take(sim, null_mut());
        sinew_snapshot_restore(none, null());
        sinew_snapshot_restore(sim, null());
        sinew_snapshot_to_bytes(null(), null_mut(), 0, null_mut());
        sinew_snapshot_from_bytes(null(), 9, null_mut());
    }
    for (function, status) in &table {
        assert_eq!(*status, SINEW_ARGUMENT, "{function}");
    }
    assert!(said().contains("NULL"), "{}", said());
    unsafe {
        sinew_simulation_free(null_mut());
        sinew_mesh_free(null_mut());
        sinew_snapshot_free(null_mut());
        sinew_haptic_free(null_mut());
        sinew_live_free(null_mut());
    }
    // no function of the header is left out
    let without_pointers = [
        "sinew_abi_version",
        "sinew_version",
        "sinew_simulation_free",
        "sinew_mesh_free",
        "sinew_snapshot_free",
        "sinew_haptic_free",
        "sinew_live_free",
    ];
    for name in header::functions() {
        let known = table.iter().any(|(own, _)| *own == name);
        assert!(known || without_pointers.contains(&name.as_str()), "{name} is in no table");
    }
    ok(unsafe { sinew_step(sim, 1) });
}

#[test]
fn wrong_handles_are_told() {
    let slab = Slab::new(1);
    let (sim, hold) = (slab.sim, slab.hold);
    let (mut number, mut wide) = (0, 0);
    let mut xyz = [0.0; 3];
    let name = c("x");
    let vertex = [0u32];
    let region = sized!(sinew_region { kind: SINEW_STRAIN_ABOVE, above: 1.0 });
    let pull = sized!(sinew_pull {
        name: name.as_ptr(),
        vertices: vertex.as_ptr(),
        vertex_count: 1,
        stiffness: 1.0,
    });
    let constraint = sized!(sinew_constraint {
        name: name.as_ptr(),
        vertices: vertex.as_ptr(),
        vertex_count: 1
    });
    let mut report = sized!(sinew_tool_report {});
    let [mut first, mut second] = [0; 2];
    let hand = sized!(sinew_haptic_options {
        name: name.as_ptr(),
        vertices: vertex.as_ptr(),
        vertex_count: 1,
    });
    let (mut device, mut live) = (null_mut(), null_mut());
    let liver = c("liver");
    let material = sized!(sinew_material { preset: liver.as_ptr() });
    for handle in [0, u64::MAX, hold ^ 1, slab.body ^ (1 << 40), 3 << 56] {
        let mut table = Vec::new();
        calls! { table:
            sinew_remove(sim, handle);
            sinew_haptic_release(sim, handle);
            sinew_vertex_count(sim, handle, &mut number);
            sinew_group_vertices(sim, handle, name.as_ptr(), null_mut(), 0, &mut number);
            sinew_read(sim, handle, SINEW_VELOCITIES, null_mut(), 0, &mut number);
            sinew_positions_f32(sim, handle, null_mut(), 0, 12);
            sinew_set_state(sim, handle, null(), null(), 0);
            sinew_surface(sim, handle, null_mut(), 0, &mut number, null_mut());
            sinew_set_material(sim, handle, &material);
            sinew_set_activation(sim, handle, name.as_ptr(), 0.5);
            sinew_remove_elements(sim, handle, &region, null_mut());
            sinew_cut(sim, handle, xyz.as_ptr(), 0, null_mut());
            sinew_skin_read(sim, handle, 0, null_mut(), 0, &mut number);
            sinew_skin_triangles(sim, handle, null_mut(), 0, &mut number, null_mut());
            sinew_skin_wound(sim, handle, null_mut(), 0, &mut number);
            sinew_hold(sim, handle, name.as_ptr(), vertex.as_ptr(), 1, &mut wide);
            sinew_constraint_add(sim, handle, &constraint, &mut wide);
            sinew_constraint_pose(sim, handle, null(), null(), null());
            sinew_reaction(sim, handle, null(), null_mut(), null_mut());
            sinew_load_add(sim, handle, name.as_ptr(), vertex.as_ptr(), 1, xyz.as_ptr(), 1, &mut wide);
            sinew_pressure_add(sim, handle, name.as_ptr(), [0, 1, 2].as_ptr(), 1, 1.0, &mut wide);
            sinew_traction_add(sim, handle, name.as_ptr(), null(), 0, 3, xyz.as_ptr(), &mut wide);
            sinew_tool_move(sim, handle, xyz.as_ptr(), null(), 0.0, 0);
            sinew_tool_grip(sim, handle, 1);
            sinew_read_tool_report(sim, handle, &mut report);
            sinew_tool_parts(sim, handle, null_mut(), 0, &mut number);
            sinew_contact_add(sim, name.as_ptr(), handle, slab.body, 0.0, &mut wide);
            sinew_contact_force(sim, handle, xyz.as_mut_ptr(), null_mut());
            sinew_pull_add(sim, handle, &pull, &mut wide);
            sinew_pull_move(sim, handle, null(), null(), null());
            sinew_pull_force(sim, handle, xyz.as_mut_ptr(), null_mut());
            sinew_read(sim, handle, SINEW_THREAD_SPANS, null_mut(), 0, &mut number);
            sinew_read(sim, handle, SINEW_TEAR, null_mut(), 0, &mut number);
            sinew_thread_move(sim, handle, 0, xyz.as_ptr());
            sinew_thread_draw(sim, handle, 0, 0.0);
            sinew_thread_hold(sim, handle, 0);
            sinew_thread_tie(sim, handle);
            sinew_thread_cut(sim, handle, 0, &mut first, &mut second);
            sinew_tear_set(sim, handle, null());
            sinew_haptic_add(sim, handle, &hand, &mut wide, &mut device);
            sinew_live_share(sim, &handle, 1, null(), 0, &mut live);
            sinew_live_share(sim, null(), 0, &handle, 1, &mut live);
        }
        for (function, status) in table {
            assert_eq!(status, SINEW_HANDLE, "{function} {handle:x}: {}", said());
        }
    }
}

#[test]
fn wrong_sizes_of_structures_are_told() {
    let slab = Slab::new(1);
    let (name, slab_device) = (c("x"), crate::live::device(&slab).1);
    for size in [0, 4, u32::MAX] {
        let (mut sim, mut mesh, mut handle) = (null_mut(), null_mut(), 0);
        let options = sized!(sinew_options { struct_size: size });
        let arrays = sized!(sinew_mesh_arrays { struct_size: size });
        let material = sized!(sinew_material { struct_size: size });
        let body = sized!(sinew_body { struct_size: size });
        let mut cut = sized!(sinew_cut_report { struct_size: size });
        let inner = sized!(sinew_body { name: name.as_ptr(), material: &material });
        let constraint = sized!(sinew_constraint { struct_size: size });
        let part = sized!(sinew_part { struct_size: size });
        let tool = sized!(sinew_tool { struct_size: size });
        let held = sized!(sinew_tool { name: name.as_ptr(), parts: &part, part_count: 1 });
        let mut report = sized!(sinew_tool_report { struct_size: size });
        let pull = sized!(sinew_pull { struct_size: size });
        let mut pick = sized!(sinew_pick_result { struct_size: size });
        let region = sized!(sinew_region { struct_size: size });
        let haptic = sized!(sinew_haptic_options { struct_size: size });
        let mut felt = sized!(sinew_haptic_feedback { struct_size: size });
        let (mut device, zero) = (null_mut(), [0.0; 3].as_ptr());
        let mut table = Vec::new();
        calls! { table:
            sinew_simulation_new(&options, &mut sim);
            sinew_mesh_from_arrays(&arrays, &mut mesh);
            sinew_body_add(slab.sim, slab.mesh, &body, &mut handle);
            sinew_body_add(slab.sim, slab.mesh, &inner, &mut handle);
            sinew_set_material(slab.sim, slab.body, &material);
            sinew_constraint_add(slab.sim, slab.body, &constraint, &mut handle);
            sinew_tool_add(slab.sim, &tool, &mut handle);
            sinew_tool_add(slab.sim, &held, &mut handle);
            sinew_read_tool_report(slab.sim, 0, &mut report);
            sinew_pull_add(slab.sim, slab.body, &pull, &mut handle);
            sinew_pick(slab.sim, [0.0; 3].as_ptr(), [1.0; 3].as_ptr(), &mut pick);
            sinew_remove_elements(slab.sim, slab.body, &region, null_mut());
            sinew_cut(slab.sim, slab.body, [0.0; 12].as_ptr(), 2, &mut cut);
            sinew_haptic_add(slab.sim, slab.body, &haptic, &mut handle, &mut device);
            sinew_haptic_exchange(slab_device, zero, zero, 0.001, &mut felt);
            sinew_haptic_exchange_pose(slab_device, zero, null(), zero, zero, 0.001, &mut felt);
        }
        for (function, status) in table {
            assert_eq!(status, SINEW_ARGUMENT, "{function}: {}", said());
            assert!(
                said().contains(&format!("its struct_size is {size}; in ABI {SINEW_ABI}")),
                "{}",
                said()
            );
        }
        assert!(sim.is_null() && mesh.is_null() && device.is_null() && handle == 0);
    }
    unsafe { sinew_haptic_free(slab_device) };
}

#[test]
fn numbers_and_texts_that_cannot_be_used_are_told() {
    let slab = Slab::new(1);
    let (sim, body) = (slab.sim, slab.body);
    let mut handle = 0;
    // the second is no UTF-8
    let (name, latin) = (c("x"), std::ffi::CString::new(vec![b'l', 0xe9]).unwrap());
    let argument = |status: sinew_status, text: &str| {
        assert_eq!(status, SINEW_ARGUMENT, "{}", said());
        assert!(said().contains(text), "{} has no `{text}`", said());
    };
    let mut seven = [0.0; 7];
    let odd = seven.as_mut_ptr().cast::<u8>().wrapping_add(1).cast::<f64>();
    unsafe {
        argument(sinew_find(sim, 99, name.as_ptr(), &mut handle), "kind: 99 is none");
        argument(sinew_find(sim, 1, name.as_ptr(), &mut handle), "unknown body `x`");
        argument(sinew_find(sim, 1, latin.as_ptr(), &mut handle), "it is not UTF-8");
        argument(sinew_set_dt(sim, f64::NAN), "step length dt = NaN s");
        argument(sinew_read(sim, body, 77, null_mut(), 0, &mut 0), "quantity: 77 is none");
        let mut needed = 0;
        argument(
            sinew_read(sim, body, 0, seven.as_mut_ptr(), 7, &mut needed),
            "room for 7 entries, 225",
        );
        assert_eq!(needed, 225);
        argument(sinew_read(sim, body, 0, odd, 300, &mut needed), "its address is not that");
        argument(sinew_set_state(sim, body, seven.as_ptr(), seven.as_ptr(), 2), "6 numbers given");
        argument(
            sinew_set_state(sim, body, seven.as_ptr(), seven.as_ptr(), usize::MAX),
            "more than memory",
        );
        argument(sinew_positions_f32(sim, body, null_mut(), 3, 12), "3 given, the body has 75");
        argument(
            sinew_positions_f32(sim, body, [0f32; 225].as_mut_ptr(), 75, 8),
            "a stride of 8 bytes",
        );
        argument(
            sinew_positions_f32(sim, body, [0f32; 225].as_mut_ptr(), 75, usize::MAX),
            "too much",
        );
        let part = sized!(sinew_part { shape: 17 });
        let tool = sized!(sinew_tool { name: name.as_ptr(), parts: &part, part_count: 1 });
        argument(sinew_tool_add(sim, &tool, &mut handle), "shape: 17 is none");
        let part = sized!(sinew_part { shape: SINEW_CLOSED_MESH });
        let tool = sized!(sinew_tool { name: name.as_ptr(), parts: &part, part_count: 1 });
        argument(sinew_tool_add(sim, &tool, &mut handle), "mesh of a part: it is NULL");
        let options = sized!(sinew_options { dt: 0.01, precision: 2 });
        argument(sinew_simulation_new(&options, &mut null_mut()), "precision: 2 is none");
        let toml = c("name = 3");
        let status =
            sinew_simulation_from_text(toml.as_ptr(), name.as_ptr(), null(), 0, 0, &mut null_mut());
        assert_eq!(status, SINEW_SCENE, "{}", said());
        assert_eq!(sinew_mesh_from_file(c("no.msh").as_ptr(), &mut null_mut()), SINEW_IO);
        ok(sinew_step(sim, 0));
    }
}

#[test]
fn snapshots_of_something_else_change_nothing() {
    let slab = Slab::new(1);
    ok(unsafe { sinew_step(slab.sim, 3) });
    let before = slab.hash();
    let mut other = null_mut();
    let mut foreign = null_mut();
    unsafe {
        // bytes that are none, and none at all
        for bytes in [&b"not a snapshot"[..], &[]] {
            let status = sinew_snapshot_from_bytes(bytes.as_ptr(), bytes.len(), &mut foreign);
            assert_eq!((status, foreign.is_null()), (SINEW_SNAPSHOT, true), "{}", said());
        }
        // one of a simulation without bodies
        ok(sinew_simulation_new(&sized!(sinew_options { dt: 0.01 }), &mut other));
        ok(sinew_snapshot_take(other, &mut foreign));
        assert_eq!(sinew_snapshot_restore(slab.sim, foreign), SINEW_SNAPSHOT, "{}", said());
        let (mut needed, mut little) = (0, [0u8; 4]);
        ok(sinew_snapshot_to_bytes(foreign, null_mut(), 0, &mut needed));
        let status = sinew_snapshot_to_bytes(foreign, little.as_mut_ptr(), 4, &mut needed);
        assert_eq!(status, SINEW_ARGUMENT);
        assert!(said().contains("room for 4 entries"), "{}", said());
        sinew_snapshot_free(foreign);
        sinew_simulation_free(other);
    }
    assert_eq!(slab.hash(), before);
}

#[test]
fn panics_stop_at_the_edge() {
    for (pool, threads) in [(0, 1), (1, 2)] {
        let slab = Slab::new(threads);
        ok(unsafe { sinew_step(slab.sim, 2) });
        assert_eq!(unsafe { sinew_test_panic(slab.sim, pool) }, SINEW_PANIC);
        assert!(
            said().starts_with(
                ["a panic in a call", "a panic on a thread of the pool"][pool as usize]
            )
        );
        for _ in 0..2 {
            assert_eq!(unsafe { sinew_step(slab.sim, 1) }, SINEW_PANIC);
            assert!(
                said().starts_with("the simulation cannot be used any more after a panic: a panic")
            );
        }
        let mut seconds = 7.0;
        assert_eq!(unsafe { sinew_time(slab.sim, &mut seconds) }, SINEW_PANIC);
        assert_eq!(seconds, 7.0);
        // others are not touched
        let other = Slab::new(threads);
        ok(unsafe { sinew_step(other.sim, 1) });
    }
}

struct Shared(*mut sinew_simulation);
unsafe impl Send for Shared {}
unsafe impl Sync for Shared {}

#[test]
fn two_threads_get_ok_or_busy() {
    let slab = Slab::new(1);
    let shared = Shared(slab.sim);
    let (done, busy) = (AtomicU32::new(0), AtomicU32::new(0));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                let shared = &shared;
                for _ in 0..400 {
                    match unsafe { sinew_step(shared.0, 1) } {
                        SINEW_OK => done.fetch_add(1, Ordering::Relaxed),
                        SINEW_BUSY => {
                            assert!(said().starts_with("another call uses the simulation"));
                            std::thread::yield_now();
                            busy.fetch_add(1, Ordering::Relaxed)
                        }
                        other => panic!("{other}: {}", said()),
                    };
                }
            });
        }
    });
    let (done, busy) = (done.into_inner(), busy.into_inner());
    assert_eq!(done + busy, 800);
    assert!(busy > 0, "{done} steps, none at the same time");
    // as many steps as said OK, each whole
    let alone = Slab::new(1);
    ok(unsafe { sinew_step(alone.sim, done) });
    assert_eq!(alone.hash(), slab.hash());
}
