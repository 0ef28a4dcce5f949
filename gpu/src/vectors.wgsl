// Passes over vertex rows: the parts of the safe step between evaluations and solves. Kernels are made of functions
// NAME_at, here and in other files, as sources.rs says.
// Twin of `sinew_solvers::implicit`; sums leave one entry per workgroup in `sums`, in f32 by a fixed tree, and
// the host adds these up in f64.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;
@group(0) @binding(3) var<storage, read_write> partials: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> cg: CgState;
@group(0) @binding(5) var<storage, read_write> sums: array<vec4f>;

// What products as sums of K_ij (x_j - x_i) miss: the blocks of a row of the exact tangent sum up to 0 but where
// pressure acts.
fn row_sum_product(i: u32, x: vec3f) -> vec3f {
    if vertices[i].loaded == 0u || step.kind != 0u {
        return vec3f(0.0);
    }
    return cross(load_row(ROW_SUM, i).xyz, x);
}

// Old state with the held unknowns where they have to go; implicit Euler's drift.
fn begin_at(i: u32) {
    let free = free_axes(vertices[i].held);
    let u = load_row(U, i);
    let y = select(load_row(TARGET, i), u, free > vec4f(0.5));
    store_row(Y, i, vec4f(y.xyz, 0.0));
    store_row(MOVED, i, vec4f((y - u).xyz, 0.0));
    store_row(DRIFT, i, free * step.h * load_row(V, i));
    store_row(DAMPED, i, vec4f(0.0));
    store_row(Q, i, vec4f(0.0));
}

// Old state as the point of evaluation.
fn look_back_at(i: u32) {
    store_row(Y, i, load_row(U, i));
}

fn moved_to_direction_at(i: u32) {
    store_row(P, i, load_row(MOVED, i));
}

fn step_to_direction_at(i: u32) {
    store_row(P, i, load_row(STEP, i));
}

fn product_to_damped_at(i: u32) {
    store_row(DAMPED, i, load_row(Q, i));
}

// -dP/dd on the free unknowns, and the start vector of the linear system: where inertia would lead, or 0.
fn right_hand_side_at(i: u32) {
    let free = free_axes(vertices[i].held);
    let d = load_row(MOVED, i);
    let away = load_row(DRIFT, i) - d;
    let inertia = vertices[i].mass * (step.inertia * away - step.mass_damping * d);
    store_row(RHS, i, free * (inertia - step.stiffness_damping * load_row(DAMPED, i) + load_row(FORCE, i) + load_row(LOAD, i)));
    let warm = select(vec4f(0.0), free * away, step.warm == 1u);
    store_row(STEP, i, warm);
    store_row(P, i, warm);
}

// Sums at the start of the step.
@compute @workgroup_size(256)
fn measure_start(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var a = vec4f(0.0);
    var b = vec4f(0.0);
    for (var i = group.x * GROUP + local; i < step.n; i += groups.x * GROUP) {
        let free = free_axes(vertices[i].held);
        let v = load_row(V, i).xyz;
        let half_mass = 0.5 * vertices[i].mass;
        // kinetic energy of free and held unknowns; damping energy; loads along the way so far
        a += vec4f(
            half_mass * dot(v * v, free.xyz),
            half_mass * dot(v * v, vec3f(1.0) - free.xyz),
            dot(load_row(MOVED, i).xyz, load_row(DAMPED, i).xyz),
            dot(load_row(LOAD, i).xyz, load_row(MOVED, i).xyz),
        );
        b += vec4f(dot(load_row(LOAD, i).xyz, load_row(U, i).xyz), 0.0, 0.0, 0.0);
    }
    let first = group_sum(local, a);
    let second = group_sum(local, b);
    if local == 0u {
        sums[2u * group.x] = first;
        sums[2u * group.x + 1u] = second;
    }
}

// Coefficients of the potential along the Newton step; the largest entry of the step.
@compute @workgroup_size(256)
fn measure_search(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var a = vec4f(0.0);
    var largest = 0.0;
    for (var i = group.x * GROUP + local; i < step.n; i += groups.x * GROUP) {
        let free = free_axes(vertices[i].held).xyz;
        let m = vertices[i].mass;
        let d = load_row(STEP, i).xyz;
        let moved = load_row(MOVED, i).xyz;
        let away = free * (moved - load_row(DRIFT, i).xyz);
        let linear = m * dot(free * d, step.inertia * away + step.mass_damping * moved)
            - dot(load_row(LOAD, i).xyz, d) + step.stiffness_damping * dot(load_row(DAMPED, i).xyz, d);
        let quadratic = m * (step.inertia + step.mass_damping) * dot(free * d, d)
            + step.stiffness_damping * dot(load_row(Q, i).xyz, d);
        a += vec4f(linear, quadratic, -dot(load_row(RHS, i).xyz, d), 0.5 * m * step.inertia * dot(away, away));
        let size = abs(d);
        largest = max(largest, max(size.x, max(size.y, size.z)));
        // max() may drop NaN: the sums keep it
    }
    let first = group_sum(local, a);
    workgroupBarrier();
    tree[local] = vec4f(largest);
    workgroupBarrier();
    for (var width = GROUP / 2u; width > 0u; width = width / 2u) {
        if local < width {
            tree[local] = max(tree[local], tree[local + width]);
        }
        workgroupBarrier();
    }
    if local == 0u {
        sums[2u * group.x] = first;
        sums[2u * group.x + 1u] = tree[0];
    }
}

// Displacements at the fraction `t` of the Newton step.
fn trial_at(i: u32) {
    let free = free_axes(vertices[i].held);
    let moved = load_row(MOVED, i) + step.t * load_row(STEP, i);
    let y = select(load_row(TARGET, i), load_row(U, i) + moved, free > vec4f(0.5));
    store_row(Y, i, vec4f(y.xyz, 0.0));
}

// The way to there, and the velocity at the end of the step.
fn advance_at(i: u32) {
    let moved = load_row(MOVED, i) + step.t * load_row(STEP, i);
    store_row(MOVED, i, moved);
    store_row(P, i, moved);
    store_row(STEP, i, step.rate * moved);
}

// What a vertex adds to the sums at the end of a step.
struct EndState {
    kinetic: vec2f,    // of free and of held unknowns
    momentum: vec4f,   // and 1 where a number is not finite
    spin: vec4f,       // angular momentum
}

fn end_state(i: u32) -> EndState {
    let free = free_axes(vertices[i].held).xyz;
    let m = vertices[i].mass;
    let v = load_row(STEP, i).xyz;
    let y = load_row(Y, i).xyz;
    let p = m * v;
    let bad = !(is_finite(dot(v, v)) && is_finite(dot(y, y)));
    return EndState(
        0.5 * m * vec2f(dot(v * v, free), dot(v * v, vec3f(1.0) - free)),
        vec4f(p, f32(bad)),
        vec4f(cross(load_row(REST, i).xyz + y, p), 0.0),
    );
}

fn write_sums(group: u32, local: u32, a: vec4f, b: vec4f, c: vec4f) {
    let first = group_sum(local, a);
    let second = group_sum(local, b);
    let third = group_sum(local, c);
    if local == 0u {
        sums[3u * group] = first;
        sums[3u * group + 1u] = second;
        sums[3u * group + 2u] = third;
    }
}

// Sums at the end of the step; also where a number is not finite.
@compute @workgroup_size(256)
fn measure_end(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var a = vec4f(0.0);
    var b = vec4f(0.0);
    var c = vec4f(0.0);
    for (var i = group.x * GROUP + local; i < step.n; i += groups.x * GROUP) {
        let end = end_state(i);
        a += vec4f(
            end.kinetic,
            dot(load_row(STEP, i).xyz, load_row(DAMPED, i).xyz),
            dot(load_row(LOAD, i).xyz, load_row(MOVED, i).xyz),
        );
        b += end.momentum;
        c += end.spin;
    }
    write_sums(group.x, local, a, b, c);
}

// The energy cap: free velocities scaled.
fn cap_velocity_at(i: u32) {
    let v = load_row(STEP, i);
    store_row(STEP, i, select(v, step.scale * v, free_axes(vertices[i].held) > vec4f(0.5)));
}

// The new state becomes the old one.
fn accept_at(i: u32) {
    store_row(U, i, load_row(Y, i));
    store_row(V, i, load_row(STEP, i));
}

// Momentum that a piece without held unknowns misses: sum of rhs less factor times m times step.
@compute @workgroup_size(256)
fn missing_momentum(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var a = vec4f(0.0);
    for (var i = group.x * GROUP + local; i < step.n; i += groups.x * GROUP) {
        if vertices[i].piece == step.piece {
            let factor = (step.inertia + step.mass_damping) * vertices[i].mass;
            a += load_row(RHS, i) - factor * load_row(STEP, i);
        }
    }
    let sum = group_sum(local, a);
    if local == 0u {
        partials[group.x] = sum;
    }
}

@compute @workgroup_size(256)
fn correct_momentum(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var own = vec4f(0.0);
    for (var k = local; k < step.groups; k += GROUP) {
        own += partials[k];
    }
    let missing = group_sum(local, own);
    for (var i = group.x * GROUP + local; i < step.n; i += groups.x * GROUP) {
        if vertices[i].piece == step.piece {
            store_row(STEP, i, vec4f((load_row(STEP, i) + missing / step.piece_mass).xyz, 0.0));
        }
    }
}

// Adds it to the product with a tangent alone.
fn complete_product_at(i: u32) {
    store_row(Q, i, load_row(Q, i) + vec4f(row_sum_product(i, load_row(P, i).xyz), 0.0));
}
