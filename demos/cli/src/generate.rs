//! `sinew mesh generate`: the shapes of scenes, with their keys as options.

use clap::{Arg, ArgAction, ArgMatches, Command, FromArgMatches, Subcommand, value_parser};
use sinew_scene::scene::{Generate, SHAPES};
use std::path::PathBuf;

/// A shape and the file for its mesh.
pub struct GeneratedShape {
    name: String,
    values: Vec<(&'static str, Vec<String>)>,
    /// Mesh file to write.
    pub out: PathBuf,
}

impl GeneratedShape {
    /// The shape, as a scene has it.
    ///
    /// # Errors
    /// What is wrong with its values.
    pub fn shape(&self) -> Result<Generate, String> {
        Generate::from_words(&self.name, &self.values)
    }
}

/// A sentence of the documentation as a help text.
fn help(about: &str) -> String {
    about.trim().trim_end_matches('.').replace('`', "")
}

impl Subcommand for GeneratedShape {
    fn augment_subcommands(command: Command) -> Command {
        let shapes = SHAPES.iter().map(|shape| {
            let options = shape.keys.iter().map(|key| {
                Arg::new(key.name)
                    .long(key.name)
                    .help(help(key.about))
                    .action(ArgAction::Set)
                    .num_args(1..)
                    .value_delimiter(',')
                    .allow_negative_numbers(true)
                    .required(!key.optional)
            });
            let out = Arg::new("out")
                .long("out")
                .short('o')
                .value_name("FILE")
                .help("Mesh file to write (.msh, .vtk, .vtu)")
                .value_parser(value_parser!(PathBuf))
                .required(true);
            Command::new(shape.name).about(help(shape.about)).args(options).arg(out)
        });
        command.subcommand_required(true).arg_required_else_help(true).subcommands(shapes)
    }

    fn augment_subcommands_for_update(command: Command) -> Command {
        Self::augment_subcommands(command)
    }

    fn has_subcommand(name: &str) -> bool {
        SHAPES.iter().any(|shape| shape.name == name)
    }
}

impl FromArgMatches for GeneratedShape {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let missing = || clap::Error::new(clap::error::ErrorKind::MissingSubcommand);
        let (name, own) = matches.subcommand().ok_or_else(missing)?;
        let shape = SHAPES.iter().find(|shape| shape.name == name).ok_or_else(missing)?;
        let values = shape.keys.iter().filter_map(|key| {
            let words = own.get_many::<String>(key.name)?;
            Some((key.name, words.cloned().collect()))
        });
        let out = own.get_one::<PathBuf>("out").cloned().unwrap_or_default();
        Ok(Self { name: name.into(), values: values.collect(), out })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
