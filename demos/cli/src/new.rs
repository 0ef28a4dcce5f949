//! `sinew new` and `sinew presets`.

use clap::Args;
use sinew::models::material::{TissuePreset, YoungPoisson, presets};
use sinew_cli::{Outcome, print};
use sinew_scene::new_scene::new_scene;
use sinew_scene::text::wrapped;
use sinew_tune::table::Table;
use sinew_tune::table_of;
use std::io::{ErrorKind, Write};
use std::path::PathBuf;

#[derive(Args)]
pub struct NewArguments {
    /// Mesh of the body, or a closed surface of it.
    #[arg(long, value_name = "FILE")]
    mesh: PathBuf,
    /// What it is made of; `sinew presets` lists all.
    #[arg(long, value_name = "NAME", default_value = "liver")]
    tissue: String,
    /// File to write [default: that of the mesh with the ending .toml].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub fn new(arguments: &NewArguments) -> Outcome {
    let mesh = &arguments.mesh;
    let out = arguments.out.clone().unwrap_or_else(|| mesh.with_extension("toml"));
    let error = |e: std::io::Error| match e.kind() {
        ErrorKind::AlreadyExists => format!("{} is there already; give --out FILE", out.display()),
        _ => format!("{}: {e}", out.display()),
    };
    // beside the mesh its name will do, also where both are moved
    let name = match (mesh.parent() == out.parent(), mesh.file_name()) {
        (true, Some(name)) => PathBuf::from(name),
        _ => std::path::absolute(mesh)?,
    };
    let text = new_scene(mesh, &name.to_string_lossy(), &arguments.tissue)?;
    let file = std::fs::File::options().write(true).create_new(true).open(&out);
    file.and_then(|mut file| file.write_all(text.as_bytes())).map_err(error)?;
    let path = out.display();
    print(format_args!("written to {path}; next: sinew check {path}, sinew run {path}\n"))?;
    Ok(true)
}

#[derive(Args)]
pub struct PresetArguments {
    /// Markdown, as in docs/tissues.md.
    #[arg(long)]
    markdown: bool,
}

/// Names and constants, in Markdown with all the rest.
fn table(markdown: bool) -> Table {
    let mut table = table_of!("tissues", "Tissues"; for preset in presets();
        where { let YoungPoisson { young_modulus, poisson_ratio, density } = preset.material; }
        "tissue" => preset.name, "E (kPa)" => young_modulus / 1e3, "nu" => poisson_ratio, "density (kg/m^3)" => density,
        "what was measured, and how far publications differ" => preset.note, "source" => preset.source,
    );
    if !markdown {
        table.columns.truncate(4);
        table.rows.iter_mut().for_each(|row| row.truncate(4));
    }
    table
}

pub fn list(arguments: &PresetArguments) -> Outcome {
    if arguments.markdown {
        print(format_args!("{}", table(true).markdown()))?;
        return Ok(true);
    }
    print(format_args!("{}", table(false).text()))?;
    for TissuePreset { name, note, source, .. } in presets() {
        let about = wrapped(&format!("{note} Source: {source}."), 92, "  ");
        print(format_args!("\n{name}\n{about}"))?;
    }
    let how = "material = { preset = \"liver\" } in a [[body]]; sinew new --mesh organ.msh --tissue liver";
    print(format_args!("\nUse one: {how}\n"))?;
    Ok(true)
}
