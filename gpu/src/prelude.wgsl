// Shared by every kernel: sizes, the uniform of a step, slots of the vertex rows, sums over a workgroup.
//
// Vectors of a body lie in one buffer, slot after slot, each with one vec4f per vertex row (16 bytes; the
// fourth entry is padding). Slots are named as the vectors of `sinew_solvers::implicit`.

const GROUP: u32 = 256u;

const U: u32 = 0u;         // displacement at the start of the step (m)
const V: u32 = 1u;         // velocity at the start of the step (m/s)
const Y: u32 = 2u;         // displacement at which laws are evaluated (m)
const MOVED: u32 = 3u;     // way since the start of the step (m)
const DRIFT: u32 = 4u;     // where inertia alone would lead (m)
const TARGET: u32 = 5u;    // displacement of held unknowns at the end of the step (m)
const LOAD: u32 = 6u;      // external force (N)
const FORCE: u32 = 7u;     // elastic force at Y (N)
const RHS: u32 = 8u;       // right-hand side (N)
const STEP: u32 = 9u;      // solution of the linear system (m), then the new velocity (m/s)
const R: u32 = 10u;        // residual (N)
const Z: u32 = 11u;        // preconditioned residual (m)
const P: u32 = 12u;        // direction (m): what the matrix is multiplied with
const Q: u32 = 13u;        // product (N)
const DAMPED: u32 = 14u;   // stiffness-damping matrix times MOVED (N)
const INVERSE: u32 = 15u;  // inverse diagonal block: entries 00 01 02 11
const INVERSE_2: u32 = 16u; // and 12 22
const REST: u32 = 17u;     // rest position from the centre of the body (m)
const ROW_SUM: u32 = 18u;  // s, where the blocks of a row of the exact tangent sum up to skew(s) (N/m)

struct Step {
    n: u32,                   // vertex rows
    groups: u32,              // workgroups of kernels with sums
    matrix_groups: u32,       // partial sums that products leave
    max_iterations: u32,      // of conjugate gradients
    h: f32,                   // step (s)
    rate: f32,                // 1/h (1/s)
    inertia: f32,             // factor of the masses in the matrix (1/s^2)
    mass_damping: f32,        // mass damping over h (1/s^2)
    stiffness_damping: f32,   // stiffness damping over h
    t: f32,                   // fraction of the Newton step
    tolerance: f32,           // relative residual of the linear system
    scale: f32,               // factor on velocities
    piece: u32,               // connected piece in question
    piece_mass: f32,          // its mass times the matrix factor (kg/s^2)
    kind: u32,                // tangent: 0 exact, 1 Gauss-Newton, 2 projected
    warm: u32,                // whether the linear solve starts where inertia leads
    keep: f32,                // explicit substeps: what is kept of the velocity,
    kick: f32,                // time of the kick (s),
    drift: f32,               // and of the drift (s)
    padding: u32,
}

struct Vertex {
    mass: f32,    // kg
    held: u32,    // bits 0, 1, 2: held along x, y, z
    piece: u32,   // connected piece
    loaded: u32,  // 1 where pressure acts, so that ROW_SUM may not be 0
}

fn flat_index(group: vec3u, groups: vec3u, local: u32) -> u32 {
    return (group.y * groups.x + group.x) * GROUP + local;
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

// 1 along free axes, 0 along held ones.
fn free_axes(held: u32) -> vec4f {
    return vec4f(f32(1u - (held & 1u)), f32(1u - ((held >> 1u) & 1u)), f32(1u - ((held >> 2u) & 1u)), 0.0);
}

var<workgroup> tree: array<vec4f, 256>;

// Sum over the workgroup in the fixed order of a binary tree; every thread gets it.
fn group_sum(local: u32, own: vec4f) -> vec4f {
    workgroupBarrier();
    tree[local] = own;
    workgroupBarrier();
    for (var width = GROUP / 2u; width > 0u; width = width / 2u) {
        if local < width {
            tree[local] += tree[local + width];
        }
        workgroupBarrier();
    }
    return tree[0];
}

// Smallest number of the workgroup; every thread gets it.
fn group_min(local: u32, own: f32) -> f32 {
    workgroupBarrier();
    tree[local].x = own;
    workgroupBarrier();
    for (var width = GROUP / 2u; width > 0u; width = width / 2u) {
        if local < width {
            tree[local].x = min(tree[local].x, tree[local + width].x);
        }
        workgroupBarrier();
    }
    return tree[0].x;
}

const LARGEST: f32 = 3.4028234e38;

// A range of elements whose buffers fit one binding each.
struct Chunk {
    count: u32,        // elements
    sums: u32,         // place of its first partial energy
    rows: u32,         // vertex rows
    factor: f32,       // of loads: their value now
}
