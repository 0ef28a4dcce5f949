// Dampers along axes: a viscous matrix and neither energy nor force. Twin of `sinew_models::axes::damper`, frame included.
// Constants are rows of 16 bytes: q_a = dp/du_a (1/m), four vertices a row; then a and V eta (J s). The factor of the
// chunk is one over that of the whole damping matrix. The kind of element has VERTICES.

@group(1) @binding(1) var<storage, read> nodes: array<u32>;

const THREADS: u32 = 1u;

fn shape(i: u32, a: u32) -> f32 {
    return data[(VERTICES / 4u + 1u) * i + a / 4u][a % 4u];
}

fn energy_of(i: u32) -> f32 {
    return 0.0;
}

fn write_forces(i: u32) {}

// V eta q_a q_b n n^T, n the direction of the stretched axis.
fn write_tangents(i: u32) {
    if i >= chunk.count { return; }
    let own = data[(VERTICES / 4u + 1u) * i + VERTICES / 4u];
    let u0 = displacement(nodes[VERTICES * i]);
    var arm = own.xyz;
    for (var a = 1u; a < VERTICES; a += 1u) {
        arm += shape(i, a) * (displacement(nodes[VERTICES * i + a]) - u0);
    }
    let square = dot(arm, arm);
    // a fibre without length has no direction
    let scale = select(0.0, chunk.factor * own.w / square, square > 0.0);
    let m = scale * outer(arm, arm);
    let count = VERTICES * (VERTICES + 1u) / 2u;
    var pair = VERTICES;
    for (var a = 0u; a < VERTICES; a += 1u) {
        let q = shape(i, a);
        write_block(i, count, a, (q * q) * m);
        for (var b = a + 1u; b < VERTICES; b += 1u) {
            write_block(i, count, pair, (q * shape(i, b)) * m);
            pair += 1u;
        }
    }
}
