//! `sinew new` and `sinew presets`.

use clap::Args;
use sinew::models::material::{TissuePreset, presets};
use sinew_cli::{Outcome, print};
use sinew_scene::new_scene::new_scene;
use sinew_scene::text::wrapped;
use std::fmt::Write;
use std::io::{ErrorKind, Write as _};
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

/// The table of tissues, then what was measured, how far publications differ, and the sources.
fn table(markdown: bool) -> String {
    let mut text = String::new();
    let (head, row): (&str, fn(&mut String, &TissuePreset)) = if markdown {
        (
            "| tissue | E (kPa) | nu | density (kg/m^3) | what was measured, and how far publications differ | source |\n\
          |---|---|---|---|---|---|\n",
            |text, preset| {
                let (of, name) = (&preset.material, preset.name);
                let [e, nu, rho] = [of.young_modulus / 1e3, of.poisson_ratio, of.density];
                let _ = writeln!(
                    text,
                    "| `{name}` | {e} | {nu} | {rho} | {} | {} |",
                    preset.note, preset.source
                );
            },
        )
    } else {
        ("tissue    E (kPa)   nu    kg/m^3\n", |text, preset| {
            let (of, name) = (&preset.material, preset.name);
            let [e, nu, rho] = [of.young_modulus / 1e3, of.poisson_ratio, of.density];
            let _ = writeln!(text, "{name:<9} {e:<9} {nu:<5} {rho}");
        })
    };
    text += head;
    presets().iter().for_each(|preset| row(&mut text, preset));
    if !markdown {
        for preset in presets() {
            let _ = write!(text, "\n{}\n{}", preset.name, wrapped(preset.note, 92, "  "));
            text += &wrapped(&format!("Source: {}.", preset.source), 92, "  ");
        }
        text += "\nUse one: material = { preset = \"liver\" } in a [[body]]; sinew new --mesh organ.msh --tissue liver\n";
    }
    text
}

pub fn list(arguments: &PresetArguments) -> Outcome {
    print(format_args!("{}", table(arguments.markdown)))?;
    Ok(true)
}
