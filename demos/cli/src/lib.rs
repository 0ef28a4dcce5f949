//! What the commands `sinew` and `sinew-lab` share: output, exit codes and words of scene files as options.
#![allow(clippy::print_stderr, reason = "a command speaks to its terminal")]

use clap::ValueEnum;
use sinew::simulation::Precision;
use std::error::Error;
use std::io::Write;
use std::process::ExitCode;

/// Whether all went well; what did not has been said.
pub type Outcome = Result<bool, Box<dyn Error>>;

/// 0 when all went well, 1 for bad input or a failed run; the error goes to stderr.
pub fn exit_code(outcome: Outcome) -> ExitCode {
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Makes sure that `XDG_RUNTIME_DIR` names a folder, by starting this program again with one where it does not: the drivers of
/// Mesa look for displays there, and print an error that is none.
pub fn give_displays_a_folder() {
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt;
        const FOLDER: &str = "XDG_RUNTIME_DIR";
        let folder = std::env::var_os(FOLDER).map(std::path::PathBuf::from);
        if folder.is_some_and(|folder| folder.is_absolute() && folder.is_dir()) {
            return;
        }
        let folder = std::env::temp_dir();
        if let (true, Ok(program)) =
            (folder.is_absolute() && folder.is_dir(), std::env::current_exe())
        {
            // comes back only where it cannot be started; this one then goes on
            let arguments = std::env::args_os().skip(1);
            let _ = std::process::Command::new(program).args(arguments).env(FOLDER, folder).exec();
        }
    }
}

/// Prints a result; a reader that has had enough (`sinew ... | head`) is no error.
///
/// # Errors
/// When stdout cannot be written.
pub fn print(text: std::fmt::Arguments<'_>) -> std::io::Result<()> {
    match std::io::stdout().write_fmt(text) {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        result => result,
    }
}

/// A word of a scene file, such as an integrator.
///
/// # Errors
/// The words that there are.
pub fn choice<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_value(text.into()).map_err(|error| error.to_string())
}

/// `f32` or `f64` as an option.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum PrecisionArgument {
    /// Single precision.
    F32,
    /// Double precision.
    F64,
}

impl From<PrecisionArgument> for Precision {
    fn from(argument: PrecisionArgument) -> Self {
        match argument {
            PrecisionArgument::F32 => Self::F32,
            PrecisionArgument::F64 => Self::F64,
        }
    }
}
