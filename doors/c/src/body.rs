//! Bodies: adding, reading, changing.

use super::call::{
    fill, invalid, null, optional_text, out, out_struct, read, sinew_simulation, slice, tell, text,
    times, with,
};
use super::mesh::sinew_mesh;
use super::simulation::{add, strided, word};
use super::types::*;
use sinew_embed::{
    AxesDescription, AxisFamily, BodyDescription, DVec3, ElementKind, MassPolicy, MaterialField,
    MembraneCells, MembraneDescription, MuscleSettings, Quantity, Region, Result, YoungPoisson,
    membrane_cells, preset, spring_rule,
};
use std::borrow::Cow;
use std::ffi::c_char;

/// A material, and its lists by element.
struct Matter<'a> {
    uniform: YoungPoisson,
    lists: [Option<&'a [f64]>; 3],
}

impl<'a> Matter<'a> {
    /// # Safety
    /// `material` is NULL or points to what it says.
    unsafe fn read(material: *const sinew_material) -> Result<Self> {
        let m = read("material", material)?;
        let base = match optional_text("preset", m.preset)? {
            Some(name) => preset(name)?,
            None => YoungPoisson { young_modulus: 0.0, poisson_ratio: 0.0, density: 0.0 },
        };
        let or = |given: f64, base: f64| if given == 0.0 { base } else { given };
        let uniform = YoungPoisson {
            young_modulus: or(m.young_modulus, base.young_modulus),
            poisson_ratio: or(m.poisson_ratio, base.poisson_ratio),
            density: or(m.density, base.density),
        };
        let list = |what: &str, data: *const f64| {
            (!data.is_null()).then(|| slice(what, data, m.element_count)).transpose()
        };
        let lists = [
            list("young_moduli", m.young_moduli)?,
            list("poisson_ratios", m.poisson_ratios)?,
            list("densities", m.densities)?,
        ];
        Ok(Self { uniform, lists })
    }

    fn field(&self) -> MaterialField<'a> {
        let [young_modulus, poisson_ratio, density] = self.lists;
        MaterialField { young_modulus, poisson_ratio, density, ..self.uniform.into() }
    }
}

/// Adds a body of a mesh.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_body_add(
    simulation: *mut sinew_simulation,
    mesh: *const sinew_mesh,
    body: *const sinew_body,
    out: *mut sinew_handle,
) -> sinew_status {
    add(simulation, out, |sim| {
        let mesh = &mesh.as_ref().ok_or_else(|| null("mesh"))?.0;
        let b = read("body", body)?;
        let name = text("name", b.name)?;
        let matter = Matter::read(b.material)?;
        let mut own = BodyDescription::new(name, mesh, matter.uniform);
        [own.young_modulus, own.poisson_ratio, own.density] = matter.lists;
        own.model = word("model", b.model)?;
        own.evaluation = word("evaluation", b.evaluation)?;
        own.volume = word("volume", b.volume)?;
        own.masses = word("masses", b.masses)?;
        own.springs = match optional_text("springs", b.springs)? {
            Some(method) => {
                Some(spring_rule(method, (b.spring_constant != 0.0).then_some(b.spring_constant))?)
            }
            None => None,
        };
        own.axes = fibres(&b)?;
        (own.spare, own.glue) = (b.spare, b.glue);
        if b.membrane.is_null() {
            return sim.add_body(mesh, &own);
        }
        let m = read("membrane", b.membrane)?;
        let which = match (m.surface, optional_text("group", m.group)?) {
            (0, None) => MembraneCells::All,
            (0, Some(group)) => MembraneCells::Group(group),
            (1, None) => MembraneCells::Surface,
            _ => return Err(invalid("membrane", "give a group, or surface 1")),
        };
        let (triangles, quads) = membrane_cells(mesh, which)?;
        let material = match m.material.is_null() {
            true => matter.uniform,
            false => Matter::read(m.material)?.uniform,
        };
        own.membrane = Some(MembraneDescription {
            quads: &quads,
            model: word("membrane model", m.model)?,
            plane: word("plane", m.plane)?,
            ..MembraneDescription::new(&triangles, m.thickness, material)
        });
        sim.add_body(mesh, &own)
    })
}

unsafe fn fibres(body: &sinew_body) -> Result<Option<AxesDescription<'static>>> {
    let mut axes =
        AxesDescription { volume_modulus: body.volume_modulus, ..AxesDescription::default() };
    for fibre in slice("fibres", body.fibres, body.fibre_count)? {
        let f = read("fibre", fibre)?;
        let name = text("name of fibres", f.name)?;
        let count = times("directions", f.direction_count, 3)?;
        let numbers = slice("directions", f.directions, count)?;
        let directions: Vec<DVec3> = numbers.chunks(3).map(DVec3::from_slice).collect();
        let muscle = match f.muscle.is_null() {
            true => None,
            false => {
                let m = read("muscle", f.muscle)?;
                let base = MuscleSettings::default();
                let or = |given: f64, base: f64| if given == 0.0 { base } else { given };
                Some(MuscleSettings {
                    peak_stress: m.peak_stress,
                    optimal_stretch: or(m.optimal_stretch, base.optimal_stretch),
                    width: or(m.width, base.width),
                    stiffening: m.stiffening,
                    shortening: m.shortening,
                    curve: None,
                })
            }
        };
        axes.families.push(AxisFamily {
            name: Cow::Owned(name.to_string()),
            directions: Cow::Owned(directions),
            modulus: f.modulus,
            form: word("form of fibres", f.form)?,
            viscosity: f.viscosity,
            share: None,
            muscle,
        });
    }
    Ok((!axes.families.is_empty() || axes.volume_modulus != 0.0).then_some(axes))
}

/// Number of vertices of the mesh of a body: length of every list of vertices. It may grow: ask again when the revision that
/// `sinew_surface` tells is another one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_vertex_count(
    simulation: *const sinew_simulation,
    body: sinew_handle,
    count: *mut usize,
) -> sinew_status {
    with(simulation, |sim| {
        *out("count", count)? = sim.vertex_count(body)?;
        Ok(())
    })
}

/// Vertices of a group of its mesh. `needed` says how many there are, `out` may be NULL with capacity 0 to ask.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_group_vertices(
    simulation: *const sinew_simulation,
    body: sinew_handle,
    group: *const c_char,
    out: *mut u32,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with(simulation, |sim| {
        let vertices = sim.group(body, text("group", group)?)?;
        fill(&vertices, out, capacity, needed)
    })
}

/// Reads numbers of a body in the order of its mesh, or of a thread or clip: `SINEW_POSITIONS` and so on. `needed` says how many numbers there are,
/// `out` may be NULL with capacity 0 to ask.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_read(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    quantity: u32,
    out: *mut f64,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with(simulation, |sim| {
        let known = Quantity::of(quantity);
        let known = known.ok_or_else(|| invalid("quantity", format!("{quantity} is none")))?;
        fill(&sim.numbers(body, known)?, out, capacity, needed)
    })
}

/// Positions (m) as three `float` a vertex straight into a vertex buffer: those of vertex `i` begin `i * stride_bytes` after
/// `xyz`, and nothing else is written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_positions_f32(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    xyz: *mut f32,
    vertices: usize,
    stride_bytes: usize,
) -> sinew_status {
    with(simulation, |sim| {
        let count = sim.vertex_count(body)?;
        if vertices != count {
            let problem = format!("{vertices} given, the body has {count}");
            return Err(invalid("vertices", problem));
        }
        sim.positions_f32(body, strided(xyz, count, stride_bytes)?, stride_bytes)
    })
}

/// Sets displacements (m) and velocities (m/s), three numbers a vertex each.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_set_state(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    displacements: *const f64,
    velocities: *const f64,
    vertices: usize,
) -> sinew_status {
    with(simulation, |sim| {
        let count = times("vertices", vertices, 3)?;
        let u = slice("displacements", displacements, count)?;
        sim.set_state(body, u, slice("velocities", velocities, count)?)
    })
}

/// Triangles to draw a body by, three vertices each. `needed` says how many indices there are, `revision` (or NULL) changes
/// with them; `out` may be NULL with capacity 0 to ask.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_surface(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    triangles: *mut u32,
    capacity: usize,
    needed: *mut usize,
    revision: *mut u64,
) -> sinew_status {
    with(simulation, |sim| {
        let surface = sim.surface(body)?;
        tell("revision", revision, surface.revision)?;
        fill(surface.triangles.as_flattened(), triangles, capacity, needed)
    })
}

/// Gives a body another material from the next step on.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_set_material(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    material: *const sinew_material,
) -> sinew_status {
    with(simulation, |sim| {
        let matter = Matter::read(material)?;
        sim.set_material(body, matter.field()).map(drop)
    })
}

/// Sets the activation (0 to 1) of a family of active fibres.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_set_activation(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    family: *const c_char,
    activation: f64,
) -> sinew_status {
    with(simulation, |sim| sim.set_activation(body, text("family", family)?, activation))
}

/// Removes elements from a body; `removed` (or NULL) is how many went.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_remove_elements(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    region: *const sinew_region,
    removed: *mut usize,
) -> sinew_status {
    with(simulation, |sim| {
        let r = read("region", region)?;
        let (from, to) = (DVec3::from_array(r.from), DVec3::from_array(r.to));
        let (radius, above) = (r.radius, r.above);
        let region = match r.kind {
            SINEW_LIST => {
                let list = slice("list", r.list, r.list_count)?.to_vec();
                match element(r.element)? {
                    ElementKind::Tetrahedron => Region::Tetrahedra(list),
                    ElementKind::Hexahedron => Region::Hexahedra(list),
                    ElementKind::Triangle => Region::Triangles(list),
                    ElementKind::Quad => Region::Quads(list),
                }
            }
            SINEW_BALL => Region::Sphere { centre: from, radius },
            SINEW_SWEPT_BALL => Region::Capsule { from, to, radius },
            SINEW_STRAIN_ABOVE => Region::Strain { above },
            SINEW_STRESS_ABOVE => Region::Stress { above },
            other => return Err(invalid("region", format!("kind {other} is none"))),
        };
        let mass = match r.keep_mass {
            0 => MassPolicy::Recompute,
            1 => MassPolicy::Keep,
            other => return Err(invalid("keep_mass", format!("{other} is neither 0 nor 1"))),
        };
        let report = sim.remove_elements(body, region, mass)?;
        let lists = [report.tetrahedra, report.hexahedra, report.triangles, report.quads];
        tell("removed", removed, lists.iter().map(Vec::len).sum())
    })
}

/// Cuts a body along the surface that a blade sweeps, at once, in its present shape: one of solid elements, or of a membrane of
/// triangles alone; demos/scenes/README.md tells which. `strip` holds both ends (m) of the edge of the blade, six numbers a
/// position, at two positions or more. The body needs `spare`. `report` may be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_cut(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    strip: *const f64,
    position_count: usize,
    report: *mut sinew_cut_report,
) -> sinew_status {
    with(simulation, |sim| {
        let place = if report.is_null() { None } else { Some(out_struct("report", report)?) };
        let numbers = slice("strip", strip, times("positions", position_count, 6)?)?;
        let ends = numbers.as_chunks::<6>().0.iter();
        let ends = ends.map(|x| [DVec3::from_slice(&x[..3]), DVec3::from_slice(&x[3..])]);
        let made = sim.cut(body, &ends.collect::<Vec<_>>())?;
        if let Some(place) = place {
            *place = sinew_cut_report {
                struct_size: place.struct_size,
                reserved: 0,
                separated: made.separated.len(),
                copies: made.copies.len(),
                vertices: made.vertices,
                spare: made.spare,
                pieces: made.pieces,
                least_share: made.least_share,
                area: made.area,
            };
        }
        Ok(())
    })
}

/// Reads numbers of the points to draw of a body, cut or not: `SINEW_SKIN_POINTS` and so on. They are those of all vertices of
/// its mesh, then of all points of a surface that it carries, then of points that cuts made. `needed` says how many numbers there are, `out` may be NULL with capacity 0 to ask.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_skin_read(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    quantity: u32,
    out: *mut f64,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with(simulation, |sim| {
        let skin = sim.skin(body)?;
        let numbers = match quantity {
            SINEW_SKIN_POINTS => skin.points.as_flattened(),
            SINEW_SKIN_REST => skin.rest.as_flattened(),
            SINEW_SKIN_DEPTH => skin.depth,
            other => return Err(invalid("quantity", format!("{other} is none of a skin"))),
        };
        fill(numbers, out, capacity, needed)
    })
}

/// Triangles of these points, outward, three points each: the outside of a body and both sides of its wounds. `needed` says how
/// many indices there are, `revision` (or NULL) changes with them; `out` may be NULL with capacity 0 to ask.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_skin_triangles(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    triangles: *mut u32,
    capacity: usize,
    needed: *mut usize,
    revision: *mut u64,
) -> sinew_status {
    with(simulation, |sim| {
        let skin = sim.skin(body)?;
        tell("revision", revision, skin.revision)?;
        fill(skin.triangles.as_flattened(), triangles, capacity, needed)
    })
}

/// Of each of these triangles 1 if a cut laid it open, else 0. `needed` says how many there are, `out` may be NULL with capacity
/// 0 to ask.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_skin_wound(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    out: *mut u32,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with(simulation, |sim| {
        let wound: Vec<u32> = sim.skin(body)?.wound.iter().map(|own| u32::from(*own)).collect();
        fill(&wound, out, capacity, needed)
    })
}

fn element(kind: u32) -> Result<ElementKind> {
    Ok(match kind {
        SINEW_TETRAHEDRA => ElementKind::Tetrahedron,
        SINEW_HEXAHEDRA => ElementKind::Hexahedron,
        SINEW_TRIANGLES => ElementKind::Triangle,
        SINEW_QUADS => ElementKind::Quad,
        other => return Err(invalid("element", format!("{other} is none"))),
    })
}
