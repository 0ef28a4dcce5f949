// Elements with three springs, each of which couples two edges (angular, volumetric); one thread each. Twin of what
// they share in `sinew_models::laws::pooled`. The law has
//   nodes              binding 1 of group 1
//   VERTICES, EDGES    of an element
//   START, END         local vertices of the edges
//   ONE, OTHER         edges of the springs
//   coupled(i)         element i, by `add_edge`

const THREADS: u32 = 1u;

struct Coupled {
    edge: array<vec3f, EDGES>,      // deformed edges, start less end (m)
    change: array<f32, EDGES>,      // of squared length (m^2)
    stiffness: array<f32, 3>,       // of the springs (N/m^3)
}

fn add_edge(s: ptr<function, Coupled>, e: u32, rest: vec3f, relative: vec3f) {
    (*s).edge[e] = rest + relative;
    (*s).change[e] = squared_length_change(rest, relative);
}

fn energy_of(i: u32) -> f32 {
    let s = coupled(i);
    var sum = 0.0;
    for (var m = 0u; m < 3u; m += 1u) {
        sum += coupling_energy(s.stiffness[m], s.change[ONE[m]], s.change[OTHER[m]]);
    }
    return sum;
}

// Derivatives of the energy by the changes (N/m).
fn tensions(s: Coupled) -> array<f32, EDGES> {
    var tension = array<f32, EDGES>();
    for (var m = 0u; m < 3u; m += 1u) {
        let pull = coupling_tensions(s.stiffness[m], s.change[ONE[m]], s.change[OTHER[m]]);
        tension[ONE[m]] += pull.x;
        tension[OTHER[m]] += pull.y;
    }
    return tension;
}

fn write_forces(i: u32) {
    if i >= chunk.count { return; }
    let s = coupled(i);
    let tension = tensions(s);
    var force = array<vec3f, VERTICES>();
    for (var e = 0u; e < EDGES; e += 1u) {
        let pull = edge_pull(tension[e], s.edge[e]);
        force[START[e]] -= pull;
        force[END[e]] += pull;
    }
    for (var a = 0u; a < VERTICES; a += 1u) {
        slots[VERTICES * i + a] = vec4f(force[a], 0.0);
    }
}

// 1 at the start of edge e, -1 at its end, else 0.
fn sign_at(e: u32, a: u32) -> f32 {
    return select(0.0, 1.0, START[e] == a) - select(0.0, 1.0, END[e] == a);
}

// K = J^T B J + 2 L(s) I, see there; without the tensions s it is the Gauss-Newton one.
fn write_tangents(i: u32) {
    if i >= chunk.count { return; }
    let s = coupled(i);
    var tension = array<f32, EDGES>();
    if step.kind == 0u {
        tension = tensions(s);
    }
    for (var a = 0u; a < VERTICES; a += 1u) {
        for (var b = a; b < VERTICES; b += 1u) {
            var m = mat3x3f();
            for (var n = 0u; n < 3u; n += 1u) {
                let e = ONE[n];
                let f = OTHER[n];
                let twice = s.stiffness[n] + s.stiffness[n];
                m += outer((twice * sign_at(e, a) * sign_at(f, b)) * s.edge[e], s.edge[f]);
                m += outer((twice * sign_at(f, a) * sign_at(e, b)) * s.edge[f], s.edge[e]);
            }
            var pull = 0.0;
            for (var e = 0u; e < EDGES; e += 1u) {
                pull += 2.0 * tension[e] * sign_at(e, a) * sign_at(e, b);
            }
            m += pull * identity();
            let pair = VERTICES + a * (2u * VERTICES - a - 1u) / 2u + b - a - 1u;
            write_block(i, VERTICES + EDGES, select(pair, a, a == b), m);
        }
    }
}
