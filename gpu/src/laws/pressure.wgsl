// Follower pressure. Twin of `sinew_models::laws::pressure`: see there for the mathematics. Constants are 2 rows of 16 bytes,
// the rest edges E_1, E_2 (m); the factor of the chunk is the pressure (Pa).

struct Face {
    e1: vec3f,       // rest edges (m)
    e2: vec3f,
    w1: vec3f,       // displacements of vertices 1, 2 against vertex 0 (m)
    w2: vec3f,
    total: vec3f,    // sum of the displacements (m)
}

fn face(i: u32) -> Face {
    let u = corners(i);
    return Face(data[2u * i].xyz, data[2u * i + 1u].xyz, u[1] - u[0], u[2] - u[0], u[0] + u[1] + u[2]);
}

// Volume that a face sweeps from rest (m^3).
fn swept_volume(f: Face) -> f32 {
    let rest = cross(f.e1, f.e2);
    let first = cross(f.e1, f.w2) + cross(f.w1, f.e2);
    return dot(f.total, rest + 0.5 * first + cross(f.w1, f.w2) / 3.0) / 6.0;
}

fn energy_of(i: u32) -> f32 {
    return -chunk.factor * swept_volume(face(i));
}

fn write_forces(i: u32) {
    if i >= chunk.count { return; }
    let f = face(i);
    let own = vec4f(chunk.factor / 6.0 * cross(f.e1 + f.w1, f.e2 + f.w2), 0.0);
    slots[3u * i] = own;
    slots[3u * i + 1u] = own;
    slots[3u * i + 2u] = own;
}

fn write_tangents(i: u32) {
    if i >= chunk.count { return; }
    let f = face(i);
    let a = f.e1 + f.w1;
    let b = f.e2 + f.w2;
    let c = -chunk.factor / 12.0;
    write_block(i, 6u, 0u, mat3x3f());
    write_block(i, 6u, 1u, mat3x3f());
    write_block(i, 6u, 2u, mat3x3f());
    write_block(i, 6u, 3u, skew(c * (a - 2.0 * b)));
    write_block(i, 6u, 4u, skew(c * (2.0 * a - b)));
    write_block(i, 6u, 5u, skew(c * (a + b)));
}

// The blocks of a row sum up to skew(s): products that count on sums of zero miss s x p. Where faces go all round a
// vertex, what they have of s cancels.
@compute @workgroup_size(256)
fn row_sums(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.count { return; }
    let f = face(i);
    let a = f.e1 + f.w1;
    let b = f.e2 + f.w2;
    let c = -0.25 * chunk.factor;
    slots[3u * i] = vec4f(c * (a - b), 0.0);
    slots[3u * i + 1u] = vec4f(c * b, 0.0);
    slots[3u * i + 2u] = vec4f(-c * a, 0.0);
}
