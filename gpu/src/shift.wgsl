// From the tangent to the system of a step. Twin of `SystemMatrix::assemble` and `definite_inverse` in
// `sinew_solvers::system`.

struct Part {
    first: u32,
    count: u32,
    partial: u32,
    groups: u32,
}

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> part: Part;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;
@group(0) @binding(3) var<storage, read> row_start: array<u32>;
@group(0) @binding(4) var<storage, read> columns: array<u32>;
@group(0) @binding(5) var<storage, read_write> system: array<f32>;
@group(0) @binding(6) var<storage, read> damping: array<f32>;
@group(0) @binding(7) var<storage, read_write> rows: array<vec4f>;

fn holds(held: u32, axis: u32) -> bool {
    return ((held >> axis) & 1u) == 1u;
}

// K + c_C C in place of K, and the inverses of the diagonal blocks of A = c_M M + K + c_C C with held unknowns taken
// out. Products add the masses and take held unknowns out by themselves.
@compute @workgroup_size(256)
fn shift(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let row = flat_index(group, groups, local);
    if row >= part.count { return; }
    let i = part.first + row;
    let own = vertices[i];
    var diagonal = array<f32, 9>();
    let damped = step.stiffness_damping != 0.0;
    let end = row_start[row + 1u];
    for (var k = row_start[row]; k < end; k += 1u) {
        let is_diagonal = columns[k] == i;
        if !(damped || is_diagonal) { continue; }
        for (var x = 0u; x < 9u; x += 1u) {
            var value = system[9u * k + x];
            if damped {
                value += step.stiffness_damping * damping[9u * k + x];
                system[9u * k + x] = value;
            }
            if is_diagonal {
                let a = x / 3u;
                let b = x - 3u * a;
                if a == b {
                    value += (step.inertia + step.mass_damping) * own.mass;
                }
                if holds(own.held, a) || holds(own.held, b) {
                    value = select(0.0, 1.0, a == b);
                }
                diagonal[x] = value;
            }
        }
    }
    let inverse = definite_inverse(diagonal);
    rows[INVERSE * step.n + i] = vec4f(inverse[0], inverse[1], inverse[2], inverse[3]);
    rows[INVERSE_2 * step.n + i] = vec4f(inverse[4], inverse[5], 0.0, 0.0);
}

// Entries 00 01 02 11 12 22 of the inverse; that of the absolute diagonal where the block is not positive
// definite.
fn definite_inverse(m: array<f32, 9>) -> array<f32, 6> {
    // scaled to order 1, so that determinants stay within the range of f32
    let scale = max(m[0], max(m[4], m[8]));
    let s = select(1.0, 1.0 / scale, scale > 0.0);
    let a = s * m[0];
    let b = s * m[1];
    let c = s * m[2];
    let d = s * m[4];
    let e = s * m[5];
    let f = s * m[8];
    let c00 = d * f - e * e;
    let c01 = c * e - b * f;
    let c02 = b * e - c * d;
    let minor = a * d - b * b;
    let det = a * c00 + b * c01 + c * c02;
    let margin = 1.1920929e-7;
    if scale > 0.0 && a > 0.0 && minor > margin * a && det > margin * minor {
        let q = s / det;
        return array<f32, 6>(q * c00, q * c01, q * c02, q * (a * f - c * c), q * (b * c - a * e), q * minor);
    }
    let size = max(abs(m[0]), max(abs(m[4]), abs(m[8])));
    let p = vec3f(max(abs(m[0]), 1e-3 * size), max(abs(m[4]), 1e-3 * size), max(abs(m[8]), 1e-3 * size));
    let r = select(vec3f(1.0), 1.0 / p, p > vec3f(0.0));
    return array<f32, 6>(r.x, 0.0, 0.0, r.y, 0.0, r.z);
}
