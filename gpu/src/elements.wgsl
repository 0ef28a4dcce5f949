// Frame of the passes over tetrahedra: what is common to all laws of tetrahedra. A law file follows, with
//   energy(e, g)           energy (J)
//   vertex_forces(e, g)    forces on vertices 1, 2, 3 in the columns (N); from a stress in stress.wgsl
//   core(e, g, kind)       tangent blocks of vertices 1, 2, 3: 11 22 33 12 13 23 (N/m)
// in terms of the element e and its displacement gradient g.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;
@group(1) @binding(0) var<uniform> chunk: Chunk;
@group(1) @binding(1) var<storage, read> nodes: array<vec4u>;
@group(1) @binding(2) var<storage, read> data: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> slots: array<vec4f>;
@group(1) @binding(4) var<storage, read_write> blocks: array<f32>;

// A tetrahedron. Constants are 3 rows of 16 bytes, D_1 (1/m) and lambda V, D_2 and mu V, D_3 and kappa V (J): the
// volume is multiplied into the moduli. w holds the displacements of vertices 1, 2, 3 against vertex 0 (m).
struct Element {
    w: mat3x3f,
    d1: vec3f,
    d2: vec3f,
    d3: vec3f,
    lambda: f32,
    mu: f32,
    compression: f32,
}

fn element(index: u32) -> Element {
    let a = data[3u * index];
    let b = data[3u * index + 1u];
    let c = data[3u * index + 2u];
    let v = nodes[index];
    let base = Y * step.n;
    let u0 = rows[base + v.x].xyz;
    let w = mat3x3f(rows[base + v.y].xyz - u0, rows[base + v.z].xyz - u0, rows[base + v.w].xyz - u0);
    return Element(w, a.xyz, b.xyz, c.xyz, a.w, b.w, c.w);
}

// G = sum_a u_a (x) D_a; D_0 = -(D_1 + D_2 + D_3) turns the sum into one over displacements relative to vertex 0.
fn displacement_gradient(e: Element) -> mat3x3f {
    return outer(e.w[0], e.d1) + outer(e.w[1], e.d2) + outer(e.w[2], e.d3);
}

fn trace(m: mat3x3f) -> f32 {
    return m[0].x + m[1].y + m[2].z;
}

// cof G: its columns are vector products of the other two.
fn cofactor_matrix(g: mat3x3f) -> mat3x3f {
    return mat3x3f(cross(g[1], g[2]), cross(g[2], g[0]), cross(g[0], g[1]));
}

// J - 1 from the invariants of G: nothing cancels.
fn volume_change(g: mat3x3f) -> f32 {
    let c = cofactor_matrix(g);
    return trace(g) + trace(c) + dot(g[0], c[0]);
}

// cof F = I + (tr G) I - G^T + cof G, the derivative of J by F.
fn cofactor(g: mat3x3f) -> mat3x3f {
    return (1.0 + trace(g)) * identity() - transpose(g) + cofactor_matrix(g);
}

// E = (G + G^T + G^T G)/2.
fn green_strain(g: mat3x3f) -> mat3x3f {
    return 0.5 * (g + transpose(g) + transpose(g) * g);
}

// w such that skew(w) v = w x v.
fn skew(w: vec3f) -> mat3x3f {
    return mat3x3f(0.0, w.z, -w.y, -w.z, 0.0, w.x, w.y, -w.x, 0.0);
}

// Energy of the chunk at Y, one partial sum per workgroup.
@compute @workgroup_size(256)
fn energies(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var own = 0.0;
    for (var i = group.x * GROUP + local; i < chunk.count; i += groups.x * GROUP) {
        let e = element(i);
        own += energy(e, displacement_gradient(e));
    }
    let sum = group_sum(local, vec4f(own, 0.0, 0.0, 0.0));
    if local == 0u {
        sums[chunk.sums + group.x] = sum;
    }
}

// Smallest J of the chunk at Y and the number of elements with J <= 0, one of each per workgroup, where energies
// leave their sums.
@compute @workgroup_size(256)
fn volumes(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var smallest = 3.4028235e38;
    var inverted = 0.0;
    for (var i = group.x * GROUP + local; i < chunk.count; i += groups.x * GROUP) {
        let j = 1.0 + volume_change(displacement_gradient(element(i)));
        smallest = min(smallest, j);
        inverted += f32(j <= 0.0);
    }
    let count = group_sum(local, vec4f(inverted, 0.0, 0.0, 0.0)).x;
    workgroupBarrier();
    tree[local] = vec4f(smallest);
    workgroupBarrier();
    for (var width = GROUP / 2u; width > 0u; width = width / 2u) {
        if local < width {
            tree[local] = min(tree[local], tree[local + width]);
        }
        workgroupBarrier();
    }
    if local == 0u {
        sums[chunk.sums + group.x] = vec4f(tree[0].x, count, 0.0, 0.0);
    }
}

// Forces at Y on the four vertices of each element, into its own slots.
@compute @workgroup_size(256)
fn forces(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.count { return; }
    let e = element(i);
    let f = vertex_forces(e, displacement_gradient(e));
    slots[4u * i] = vec4f(-(f[0] + f[1] + f[2]), 0.0);
    slots[4u * i + 1u] = vec4f(f[0], 0.0);
    slots[4u * i + 2u] = vec4f(f[1], 0.0);
    slots[4u * i + 3u] = vec4f(f[2], 0.0);
}

// Tangent blocks of each element, into its own places: 00 11 22 33 01 02 03 12 13 23. Rigid translations cost
// nothing, so the row of vertex 0 is minus the sum of the others.
@compute @workgroup_size(256)
fn tangents(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.count { return; }
    let e = element(i);
    let k = core(e, displacement_gradient(e), step.kind);
    let k01 = -1.0 * (k[0] + transpose(k[3]) + transpose(k[4]));
    let k02 = -1.0 * (k[3] + k[1] + transpose(k[5]));
    let k03 = -1.0 * (k[4] + k[5] + k[2]);
    let k00 = -0.5 * ((k01 + transpose(k01)) + (k02 + transpose(k02)) + (k03 + transpose(k03)));
    let at = 90u * i;
    write_block(at, k00);
    write_block(at + 9u, k[0]);
    write_block(at + 18u, k[1]);
    write_block(at + 27u, k[2]);
    write_block(at + 36u, k01);
    write_block(at + 45u, k02);
    write_block(at + 54u, k03);
    write_block(at + 63u, k[3]);
    write_block(at + 72u, k[4]);
    write_block(at + 81u, k[5]);
}
