// Elements whose springs couple edges (angular, volumetric), one thread each. Twin of what they share in
// `sinew_models::pooled`. The law has
//   nodes             binding 1 of group 1
//   VERTICES, EDGES   of an element
//   START, END        local vertices of the edges
//   coupled(i)        element i
//   coupling(s, e, f) stiffness of the spring between edges e and f (N/m^3), 0 where there is none

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

// Derivative of the energy by the change of edge e (N/m).
fn tension(s: Coupled, e: u32) -> f32 {
    var sum = 0.0;
    for (var f = 0u; f < EDGES; f += 1u) {
        sum += tensile_tension(coupling(s, e, f), s.change[f]);
    }
    return sum;
}

// 1 at the start of edge e, -1 at its end, else 0.
fn sign_at(e: u32, a: u32) -> f32 {
    return select(0.0, 1.0, START[e] == a) - select(0.0, 1.0, END[e] == a);
}

fn energy_of(i: u32) -> f32 {
    let s = coupled(i);
    var sum = 0.0;
    for (var e = 0u; e < EDGES; e += 1u) {
        for (var f = e + 1u; f < EDGES; f += 1u) {
            sum += coupling_energy(coupling(s, e, f), s.change[e], s.change[f]);
        }
    }
    return sum;
}

fn write_forces(i: u32) {
    if i >= chunk.count { return; }
    let s = coupled(i);
    var force = array<vec3f, VERTICES>();
    for (var e = 0u; e < EDGES; e += 1u) {
        let pull = edge_pull(tension(s, e), s.edge[e]);
        force[START[e]] -= pull;
        force[END[e]] += pull;
    }
    for (var a = 0u; a < VERTICES; a += 1u) {
        slots[VERTICES * i + a] = vec4f(force[a], 0.0);
    }
}

// K = J^T B J + 2 L(s) I, see there; without the tensions s it is the Gauss-Newton one.
fn write_tangents(i: u32) {
    if i >= chunk.count { return; }
    let s = coupled(i);
    var place = VERTICES;
    for (var a = 0u; a < VERTICES; a += 1u) {
        write_block(i, VERTICES + EDGES, a, pair_block(s, a, a));
        for (var b = a + 1u; b < VERTICES; b += 1u) {
            write_block(i, VERTICES + EDGES, place, pair_block(s, a, b));
            place += 1u;
        }
    }
}

// Block of local vertices a and b.
fn pair_block(s: Coupled, a: u32, b: u32) -> mat3x3f {
    var m = mat3x3f();
    for (var e = 0u; e < EDGES; e += 1u) {
        let at_a = sign_at(e, a);
        if at_a == 0.0 { continue; }
        for (var f = 0u; f < EDGES; f += 1u) {
            let c = coupling(s, e, f) * at_a * sign_at(f, b);
            if c != 0.0 {
                m += outer((c + c) * s.edge[e], s.edge[f]);
            }
        }
        if step.kind == 0u {
            let pull = tension(s, e);
            m += (at_a * sign_at(e, b) * (pull + pull)) * identity();
        }
    }
    return m;
}
