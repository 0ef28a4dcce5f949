// Forces on vertices: the slots of the elements round each vertex, added in the order of the elements.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;
@group(1) @binding(0) var<uniform> chunk: Chunk;
@group(1) @binding(1) var<storage, read> slots: array<vec4f>;
@group(1) @binding(2) var<storage, read> starts: array<u32>;
@group(1) @binding(3) var<storage, read> sources: array<u32>;

fn sum_of_slots(i: u32, before: vec4f) -> vec4f {
    var f = before;
    let end = starts[i + 1u];
    for (var k = starts[i]; k < end; k += 1u) {
        f += vec4f(slots[sources[k]].xyz, 0.0);
    }
    return f;
}

// The first chunk of a pass overwrites,
fn gather_forces_at(i: u32) {
    rows[FORCE * step.n + i] = sum_of_slots(i, vec4f(0.0));
}

// the others add,
fn add_forces_at(i: u32) {
    rows[FORCE * step.n + i] = sum_of_slots(i, rows[FORCE * step.n + i]);
}

// and where no law acts there is nothing.
fn no_forces_at(i: u32) {
    rows[FORCE * step.n + i] = vec4f(0.0);
}

// Sums of the blocks of rows, likewise: the first chunk overwrites,
fn gather_row_sums_at(i: u32) {
    rows[ROW_SUM * step.n + i] = sum_of_slots(i, vec4f(0.0));
}

// the others add.
fn add_row_sums_at(i: u32) {
    rows[ROW_SUM * step.n + i] = sum_of_slots(i, rows[ROW_SUM * step.n + i]);
}
