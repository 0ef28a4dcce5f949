//! `sinew fit MESH` and `sinew fit --data OBSERVED.csv SCENE.toml`.

use crate::fit_data::{FitDataOptions, fit_data};
use clap::{Args, ValueEnum};
use sinew::identify::mass::MassLumping;
use sinew::identify::{ElementMethod, IdentifyError, LinearMaterial, Plane, Section};
use sinew_cli::{Outcome, print};
use sinew_tune::fit::rig::Grips;
use sinew_tune::fit::whole::{AMPLITUDES, Sharing, Target, WholeRequest};
use sinew_tune::fit::{FitRequest, file, fit_file};
use std::path::PathBuf;

/// What `--out` writes, for the long help.
const FILES: &str = "\
Files of --out: springs (pairs of vertices, N/m, rest length m), masses (kg), constants of every element,
method, material and residuals.
  FILE.json  schema \"sinew-body/1\": springs [{nodes, constant, rest_length}], masses [one per vertex],
             element_constants {triangles, quads, tetrahedra, hexahedra: lists of 3, 6, 6, 28 constants},
             mass_lumping, method, young_modulus, poisson_ratio, density, plane, thickness, report,
             whole (how a whole body was fitted, null of elements), assessment (null where the tests were not possible, untested then says why)
  FILE.csv   record,first,second,value,rest_length: lines spring (vertex, vertex, N/m, m), mass (vertex,
             kg), triangle/quad/tetrahedron/hexahedron (element, pair, N/m), and settings by name
A scene takes FILE.json by springs = \"FILE.json\" in a [[body]] with model = \"mass_spring\"; it needs none
where the same element_method finds the same springs.";

#[derive(Args)]
#[command(after_long_help = FILES)]
pub struct FitArguments {
    /// Mesh (.msh, .vtk, .vtu, .node, .ele, .obj, .stl) of tetrahedra and hexahedra, or of flat triangles
    /// and quadrilaterals; with --data a static scene (TOML).
    #[arg(value_name = "MESH|SCENE")]
    file: PathBuf,
    #[command(flatten)]
    data: FitDataOptions,
    /// Young's modulus (Pa).
    #[arg(
        long,
        value_name = "PA",
        allow_negative_numbers = true,
        required_unless_present = "data"
    )]
    young: Option<f64>,
    /// Poisson's ratio.
    #[arg(
        long,
        value_name = "NU",
        allow_negative_numbers = true,
        required_unless_present = "data"
    )]
    poisson: Option<f64>,
    /// frobenius, block, two-norm, nonnegative, two-norm-nonnegative, van-gelder, van-gelder-full, lloyd,
    /// baudet or delingette.
    #[arg(long, value_name = "METHOD", default_value = "frobenius", value_parser = method)]
    element_method: ElementMethod,
    /// What the constants are to meet: the stiffness of each element by itself; that of the assembled body (Frobenius norm); or the
    /// nodal forces of finite elements in states of tension and shear, with rest lengths. The last two are compared with springs of
    /// --element-method.
    #[arg(long, value_name = "elements|body|forces", default_value = "elements")]
    to: ToArgument,
    /// Of a whole body: every spring has a constant of its own, or every kind of pair of an element a modulus (constant times
    /// length^2 over volume).
    #[arg(long, value_name = "springs|moduli", default_value = "springs")]
    sharing: Sharing,
    /// States of --to forces: largest displacements over the length of the body.
    #[arg(long, value_name = "PART,...", value_delimiter = ',', default_values_t = AMPLITUDES, allow_negative_numbers = true)]
    amplitudes: Vec<f64>,
    /// What vanishes across a plane body.
    #[arg(long, default_value = "stress")]
    plane: PlaneArgument,
    /// Thickness (m) of a plane body.
    #[arg(long, value_name = "M", default_value_t = 1.0, allow_negative_numbers = true)]
    thickness: f64,
    /// Density (kg/m^3), for the masses.
    #[arg(long, value_name = "RHO", default_value_t = 1000.0, allow_negative_numbers = true)]
    density: f64,
    /// How the mass of an element is shared among its vertices: row-sums of the mass matrix, or nodal
    /// quadrature.
    #[arg(long, value_name = "nodal|row-sums", default_value = "row-sums")]
    masses: MassLumping,
    /// Axis of the virtual tests [default: from held to loaded nodes, or the longest].
    #[arg(long, value_name = "AXIS")]
    load_axis: Option<AxisArgument>,
    /// Group of nodes to hold in the tests [default: the lower end along the axis].
    #[arg(long, value_name = "GROUP")]
    held: Option<String>,
    /// Group of nodes to load in the tests [default: the upper end along the axis].
    #[arg(long, value_name = "GROUP")]
    loaded: Option<String>,
    /// File for springs and masses (.json or .csv, described below).
    #[arg(long, value_name = "BODY")]
    out: Option<PathBuf>,
    /// Print JSON, that of --out, instead of the report.
    #[arg(long)]
    json: bool,
}

/// A method by its name, or by the one that it had before.
fn method(name: &str) -> Result<ElementMethod, IdentifyError> {
    let method: ElementMethod = name.parse()?;
    if method.old_name() == Some(name) {
        eprintln!(
            "note: `{name}` is now called `{method}`; the next version does not know the old name"
        );
    }
    Ok(method)
}

#[derive(Clone, Copy, ValueEnum)]
enum PlaneArgument {
    Stress,
    Strain,
}

#[derive(Clone, Copy, ValueEnum)]
enum ToArgument {
    Elements,
    Body,
    Forces,
}

#[derive(Clone, Copy, ValueEnum)]
enum AxisArgument {
    X,
    Y,
    Z,
}

/// How constants of a whole body are found, if they are.
fn whole(arguments: &FitArguments) -> Result<Option<WholeRequest>, String> {
    let target = match arguments.to {
        ToArgument::Body => Target::Body,
        ToArgument::Forces => Target::Forces,
        ToArgument::Elements if arguments.sharing != Sharing::Springs => {
            return Err(
                "--sharing is of a whole body: give --to body or --to forces with it".into()
            );
        }
        ToArgument::Elements => return Ok(None),
    };
    let (sharing, amplitudes) = (arguments.sharing, arguments.amplitudes.clone());
    Ok(Some(WholeRequest { target, sharing, amplitudes }))
}

/// Springs for a mesh, which are a result whether or not they are fit for use, or constants from data.
pub fn fit(arguments: &FitArguments) -> Outcome {
    let (Some(young), Some(poisson)) = (arguments.young, arguments.poisson) else {
        return fit_data(&arguments.file, &arguments.data, arguments.json);
    };
    if !arguments.data.data.is_empty() {
        return Err(
            "give --data with a scene, or --young and --poisson with a mesh, not both".into()
        );
    }
    if let Some(path) = &arguments.out {
        file::check_name(path)?;
    }
    let request = FitRequest {
        material: LinearMaterial::new(young, poisson)?,
        density: arguments.density,
        section: Section {
            plane: match arguments.plane {
                PlaneArgument::Stress => Plane::Stress,
                PlaneArgument::Strain => Plane::Strain,
            },
            thickness: arguments.thickness,
        },
        method: arguments.element_method,
        masses: arguments.masses,
        grips: Grips {
            axis: arguments.load_axis.map(|axis| axis as usize),
            held: arguments.held.clone(),
            loaded: arguments.loaded.clone(),
        },
        whole: whole(arguments)?,
    };
    let body = fit_file(&arguments.file, &request)?;
    if arguments.json {
        print(format_args!("{}\n", serde_json::to_string_pretty(&body)?))?;
    } else {
        print(format_args!("{body}"))?;
    }
    if let Some(reason) = &body.untested {
        eprintln!(
            "warning: the springs were found but could not be tested: {reason}; choose ends that hold the body with \
             --load-axis, --held and --loaded"
        );
    }
    if let Some(path) = &arguments.out {
        file::write(path, &body)?;
        eprintln!("written to {}", path.display());
    }
    Ok(true)
}
