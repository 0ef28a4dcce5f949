// Rigid motions of aggregates in conjugate gradients: z = S r + P B P^T r with S the smoother in matrix.wgsl and B the
// inverse of the coarse matrix, kept as a whole. Twin of `sinew_solvers::coarse`, with the solve turned into a product: a triangular
// solve goes step by step, a product of 2000 rows is one pass over 16 MB.
//
// Forces and motions of aggregates have six entries each: translation, turn about the centre over the radius.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;
@group(0) @binding(3) var<storage, read_write> partials: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> cg: CgState;
@group(0) @binding(5) var<uniform> coarse: Coarse;
@group(0) @binding(6) var<storage, read> arms: array<vec4f>;           // and the aggregate
@group(0) @binding(7) var<storage, read> members: array<u32>;          // starts, then rows aggregate by aggregate
@group(0) @binding(8) var<storage, read> inverse: array<f32>;
@group(0) @binding(9) var<storage, read_write> motions: array<f32>;    // forces, then motions

// Threads of an aggregate or a row of the inverse; four of these share a workgroup. As in coarse.rs.
const LANES: u32 = 64u;
const SHARED: u32 = GROUP / LANES;
var<workgroup> force: array<vec4f, 256>;
var<workgroup> turn: array<vec4f, 256>;

// Sums over the lanes in the fixed order of a binary tree, left in the first; every thread of the workgroup takes part.
fn lane_sums(local: u32, f: vec4f, t: vec4f) {
    let lane = local % LANES;
    workgroupBarrier();
    force[local] = f;
    turn[local] = t;
    workgroupBarrier();
    for (var width = LANES / 2u; width > 0u; width = width / 2u) {
        if lane < width {
            force[local] += force[local + width];
            turn[local] += turn[local + width];
        }
        workgroupBarrier();
    }
}

// Sum of the residual over aggregates.
fn restrict_if(act: bool, group: u32, local: u32) {
    let lane = local % LANES;
    let aggregate = group * SHARED + local / LANES;
    let own = act && aggregate < coarse.aggregates;
    var f = vec3f(0.0);
    var t = vec3f(0.0);
    if own {
        let first = coarse.aggregates + 1u;
        let end = members[aggregate + 1u];
        for (var k = members[aggregate] + lane; k < end; k += LANES) {
            let i = members[first + k];
            let r = load_row(R, i).xyz;
            f += r;
            t += cross(arms[i].xyz, r);
        }
    }
    lane_sums(local, vec4f(f, 0.0), vec4f(t, 0.0));
    if own && lane < 3u {
        motions[6u * aggregate + lane] = force[local - lane][lane];
        motions[6u * aggregate + 3u + lane] = turn[local - lane][lane];
    }
}

// Motions from forces; leaves their part of r.z. Neighbouring threads read neighbouring numbers of a row.
fn move_if(act: bool, group: u32, local: u32) {
    let lane = local % LANES;
    let row = group * SHARED + local / LANES;
    let unknowns = 6u * coarse.aggregates;
    let mine = act && row < unknowns;
    var own = 0.0;
    let end = select(0u, unknowns, mine);
    for (var k = lane; k < end; k += LANES) {
        own += inverse[row * coarse.stride + k] * motions[k];
    }
    lane_sums(local, vec4f(own, 0.0, 0.0, 0.0), vec4f(0.0));
    var work = 0.0;
    if mine && lane == 0u {
        let x = force[local].x;
        motions[coarse.stride + row] = x;
        work = motions[row] * x;
    }
    let sum = group_sum(local, vec4f(work, 0.0, 0.0, 0.0));
    if act && local == 0u {
        partials[step.matrix_groups + step.groups + group] = sum;
    }
}

// Motion of a vertex with its aggregate, held unknowns left out.
fn prolong(i: u32) -> vec4f {
    let arm = arms[i];
    let at = coarse.stride + 6u * u32(arm.w);
    let t = vec3f(motions[at], motions[at + 1u], motions[at + 2u]);
    let w = vec3f(motions[at + 3u], motions[at + 4u], motions[at + 5u]);
    return free_axes(vertices[i].held) * vec4f(t + cross(w, arm.xyz), 0.0);
}

// p = z + beta p with what the smoother left in Q.
@compute @workgroup_size(256)
fn direction(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let go = atomicLoad(&cg.phase) == ITERATING;
    let sum = preconditioned_sums(local);
    if !go || sum.w > 0.0 { return; }
    let beta = sum.x / cg.rz;
    for (var i = group.x * GROUP + local; i < step.n; i += groups.x * GROUP) {
        store_row(P, i, load_row(Q, i) + prolong(i) + beta * load_row(P, i));
    }
}

// The first direction of a sequence.
fn first_direction_at(i: u32) {
    if atomicLoad(&cg.phase) != ITERATING || cg.fresh == 0u { return; }
    store_row(P, i, load_row(Q, i) + prolong(i));
}
