//! The shaders: files put together. Order does not matter in WGSL, so a module is its files one after another.

/// A module: name and text.
#[derive(Clone, Debug)]
pub struct ShaderSource {
    /// Name in labels and errors.
    pub name: &'static str,
    /// WGSL.
    pub text: String,
}

const PRELUDE: &str = include_str!("prelude.wgsl");
const STATE: &str = include_str!("state.wgsl");
const TENSORS: &str = include_str!("tensors.wgsl");
const ELEMENTS: &str = include_str!("elements.wgsl");

/// The files one after another, and the entry points that are made of functions in them.
fn module(name: &'static str, files: &[&str]) -> ShaderSource {
    let mut text = files.concat();
    for line in files.iter().flat_map(|file| file.lines()) {
        for (ending, entries) in ENTRIES {
            let kernel = line.strip_prefix("fn ").and_then(|line| line.strip_suffix(ending));
            if let Some(kernel) = kernel {
                text += &entries.replace("KERNEL", kernel);
            }
        }
    }
    ShaderSource { name, text }
}

/// Endings of functions, and entry points that call them. `NAME_at` serves a vertex row, and `NAME` calls it with a
/// thread for each; `NAME_if` does something when it is to act, and is called at the start of conjugate gradients, in
/// an iteration and for the true residual.
const ENTRIES: [(&str, &str); 2] = [
    (
        "_at(i: u32) {",
        "
@compute @workgroup_size(256)
fn KERNEL(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i < step.n { KERNEL_at(i); }
}
",
    ),
    (
        "_if(act: bool, group: u32, local: u32) {",
        "
@compute @workgroup_size(256)
fn KERNEL_start(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    KERNEL_if(true, group.x, local);
}
@compute @workgroup_size(256)
fn KERNEL_iteration(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    KERNEL_if(atomicLoad(&cg.phase) == ITERATING, group.x, local);
}
@compute @workgroup_size(256)
fn KERNEL_verify(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    KERNEL_if(atomicLoad(&cg.phase) == CLAIMED, group.x, local);
}
",
    ),
];

/// Modules without elements: name and files.
pub(crate) const SHARED: [(&str, &[&str]); 9] = [
    // passes over vertex rows, products, conjugate gradients
    (
        "solver",
        &[
            PRELUDE,
            STATE,
            include_str!("vectors.wgsl"),
            include_str!("explicit.wgsl"),
            include_str!("cg.wgsl"),
            include_str!("matrix.wgsl"),
        ],
    ),
    // motions of aggregates in conjugate gradients, matrix to coarse matrix, coarse matrix to its inverse
    ("coarse", &[PRELUDE, STATE, include_str!("coarse.wgsl")]),
    ("galerkin", &[PRELUDE, include_str!("galerkin.wgsl")]),
    ("inverse", &[PRELUDE, include_str!("inverse.wgsl")]),
    // forces of elements to vertices, tangent blocks of elements to the matrix, tangent to system
    ("gather", &[PRELUDE, include_str!("gather.wgsl")]),
    ("assemble", &[PRELUDE, include_str!("assemble.wgsl")]),
    ("shift", &[PRELUDE, include_str!("shift.wgsl")]),
    // what the bandwidth of the device is measured by
    ("copy", &[PRELUDE, include_str!("copy.wgsl")]),
    // sets of elements whose law is silent
    ("silence", &[PRELUDE, include_str!("silence.wgsl")]),
];

/// One of the [`SHARED`] modules.
pub(crate) fn shared(name: &str) -> ShaderSource {
    let found = SHARED.iter().find(|(own, _)| *own == name);
    let &(name, files) = found.expect("a name of the table");
    module(name, files)
}

/// A law from the files of its kind of element and its own.
pub(crate) fn elements(name: &'static str, kind: &[&str], law: &[&str]) -> ShaderSource {
    module(name, &[&[PRELUDE, TENSORS, ELEMENTS], kind, law].concat())
}
