// Symplectic Euler and Stormer-Verlet. Twin of `sinew_solvers::explicit`. The state of a substep is in Y and STEP;
// Z carries what displacements cannot hold, LOW the same at the start of the step. RHS holds the way of held
// unknowns through the substep, and in w the work of constraints; DAMPED in x that of loads.

const LOW: u32 = Q;

fn explicit_begin_at(i: u32) {
    let free = free_axes(vertices[i].held);
    store_row(Y, i, load_row(U, i));
    store_row(STEP, i, free * load_row(V, i));
    store_row(Z, i, free * load_row(LOW, i));
    store_row(RHS, i, vec4f(0.0));
    store_row(DAMPED, i, vec4f(0.0));
    store_row(MOVED, i, vec4f(0.0));
}

fn forget_low_at(i: u32) {
    store_row(LOW, i, vec4f(0.0));
}

// Work of constraints and loads over half a substep that ends or begins here: the trapezoidal rule.
fn book(i: u32, way: vec3f, held_way: vec3f) {
    let force = load_row(FORCE, i).xyz;
    let load = load_row(LOAD, i).xyz;
    let books = load_row(RHS, i);
    store_row(RHS, i, vec4f(held_way, books.w - 0.5 * dot(force + load, held_way)));
    store_row(DAMPED, i, load_row(DAMPED, i) + vec4f(0.5 * dot(load, way), 0.0, 0.0, 0.0));
    store_row(MOVED, i, vec4f(way, 0.0));
}

// End of a substep: its second half in the books.
fn close_books_at(i: u32) {
    book(i, load_row(MOVED, i).xyz, load_row(RHS, i).xyz);
}

// v <- keep v + kick (f / m), u <- u + drift v without loss; held unknowns to their place.
fn kick_and_drift_at(i: u32) {
    let is_free = free_axes(vertices[i].held) > vec4f(0.5);
    let m = vertices[i].mass;
    let weight = select(0.0, 1.0 / m, m > 0.0);
    let u = load_row(Y, i);
    let v = step.keep * load_row(STEP, i) + (step.kick * weight) * (load_row(FORCE, i) + load_row(LOAD, i));
    let way = step.drift * v + load_row(Z, i);
    let sum = u + way;
    let gained = sum - u;
    let low = (u - (sum - gained)) + (way - gained);
    let place = load_row(TARGET, i);
    var new_v = v;
    var new_u = sum;
    var new_low = low;
    if step.drift > 0.0 {
        let held_v = (place - u) / step.drift;
        new_v = select(held_v, v, is_free);
        new_u = select(place, sum, is_free);
        new_low = select(vec4f(0.0), low, is_free);
        let moved = (new_u - u).xyz;
        book(i, moved, select(moved, vec3f(0.0), is_free.xyz));
    } else {
        new_v = select(load_row(STEP, i), v, is_free);
    }
    store_row(STEP, i, vec4f(new_v.xyz, 0.0));
    store_row(Y, i, vec4f(new_u.xyz, 0.0));
    store_row(Z, i, vec4f(new_low.xyz, 0.0));
}

// Sums at the end of the step, in the places of `measure_end`: work of constraints and loads beside kinetic
// energies, momentum, where a number is not finite, angular momentum.
@compute @workgroup_size(256)
fn measure_explicit(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var a = vec4f(0.0);
    var b = vec4f(0.0);
    var c = vec4f(0.0);
    for (var i = group.x * GROUP + local; i < step.n; i += groups.x * GROUP) {
        let end = end_state(i);
        a += vec4f(
            end.kinetic,
            load_row(RHS, i).w,
            load_row(DAMPED, i).x,
        );
        b += end.momentum;
        c += end.spin;
    }
    write_sums(group.x, local, a, b, c);
}

fn accept_explicit_at(i: u32) {
    store_row(U, i, load_row(Y, i));
    store_row(V, i, load_row(STEP, i));
    store_row(LOW, i, load_row(Z, i));
}
