//! Natsupakpong & Cavusoglu 2010 made again.

use super::lumped::Meshes;
use super::{Paper, elements, fit_cost, pictures, shear, specimen, square, ventricle};
use crate::bench::error::BenchError;
use crate::bench::machine::MachineNotes;
use std::path::{Path, PathBuf};

const REFERENCE: &str = "Natsupakpong & Cavusoglu 2010, Determination of elasticity parameters in lumped \
                         element (mass-spring) models of deformable objects";

/// How the tables are made.
#[derive(Clone, Debug, Default)]
pub struct PaperBOptions {
    /// Folder with files `b_*.msh`; else `meshes` in the folder `SINEW_REFERENCE`, else
    /// `../shared/meshes`; where there is none, meshes are generated.
    pub meshes: Option<PathBuf>,
    /// Few rows, for tests.
    pub quick: bool,
}

/// Makes the tables of Natsupakpong & Cavusoglu 2010 with the letters given, all with none; `tell` hears
/// what is going on.
///
/// # Errors
/// When a letter is unknown, a mesh cannot be used, a test not be carried out or a chart not be drawn.
pub fn paper_b(
    only: &[char],
    options: &PaperBOptions,
    mut tell: impl FnMut(&str),
) -> Result<Paper, BenchError> {
    if let Some(letter) = only.iter().find(|c| !('a'..='f').contains(*c)) {
        return Err(BenchError::Request {
            what: format!("figure {letter}"),
            remedy: "choose of a, b, c, d, e, f".into(),
        });
    }
    let meshes = meshes(options)?;
    let quick = options.quick;
    let wanted = |letter: char| only.is_empty() || only.contains(&letter);
    let mut figures = Vec::new();
    if wanted('a') {
        tell("a: objects in tension (tables 1 and 3)");
        figures.push(elements::figure(&meshes, quick)?);
    }
    if wanted('b') {
        tell("b: time to find constants (table 2)");
        figures.push(fit_cost::figure(quick)?);
    }
    if wanted('c') {
        tell("c: the tensile specimen (tables 4 and 5)");
        figures.push(specimen::figure(&meshes, quick)?);
    }
    if wanted('d') {
        tell("d: one square (figure 9)");
        figures.push(square::figure()?);
    }
    if wanted('e') {
        tell("e: squares and cubes in shear (table 6)");
        figures.push(shear::figure(&meshes, quick)?);
    }
    if wanted('f') {
        tell("f: the ventricle floor");
        figures.push(ventricle::figure(quick)?);
    }
    let short = "Natsupakpong & Cavusoglu 2010";
    let pictures = pictures("paper-b", wanted('a') && !quick, &mut tell)?;
    Ok(Paper {
        name: "paper-b",
        reference: REFERENCE,
        short,
        machine: MachineNotes::now(),
        figures,
        pictures,
    })
}

/// Where meshes come from.
fn meshes(options: &PaperBOptions) -> Result<Meshes, BenchError> {
    if options.quick {
        return Ok(Meshes::new(None));
    }
    if let Some(folder) = &options.meshes {
        if !folder.join("b_cube_hex.msh").is_file() {
            return Err(BenchError::Request {
                what: format!("meshes in {}", folder.display()),
                remedy:
                    "there is no b_cube_hex.msh; name another folder, or none for generated meshes"
                        .into(),
            });
        }
        return Ok(Meshes::new(Some(folder)));
    }
    let named = std::env::var_os("SINEW_REFERENCE").map(|root| Path::new(&root).join("meshes"));
    let folder = named.unwrap_or_else(|| PathBuf::from("../shared/meshes"));
    Ok(Meshes::new(folder.join("b_cube_hex.msh").is_file().then_some(&*folder)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_letters_and_folders_are_named() {
        let options = PaperBOptions::default();
        let error = paper_b(&['g'], &options, |_| {}).err().unwrap().to_string();
        assert!(error.contains("figure g"), "{error}");
        let meshes = Some(PathBuf::from("nowhere"));
        let options = PaperBOptions { meshes, quick: false };
        let error = paper_b(&['a'], &options, |_| {}).err().unwrap().to_string();
        assert!(error.contains("nowhere") && error.contains("b_cube_hex.msh"), "{error}");
    }

    #[test]
    fn all_figures_in_their_quick_form() {
        let options = PaperBOptions { meshes: None, quick: true };
        let paper = paper_b(&[], &options, |_| {}).unwrap();
        let letters: String = paper.figures.iter().map(|f| f.letter).collect();
        assert_eq!(letters, "abcdef");
        let (text, html) = (paper.text(), paper.html());
        assert!(text.contains("Table 6") && html.contains("Natsupakpong &amp; Cavusoglu"));
        assert!(!text.contains("NaN"), "{text}");
    }
}
