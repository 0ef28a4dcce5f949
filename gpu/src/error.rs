//! What the device cannot do, and what to do about it.

use sinew_adapter::AdapterError;

/// Why the device does not take a scene, or gave up on one.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// No adapter.
    #[error(transparent)]
    Adapter(#[from] AdapterError),
    /// A law without a twin on the device.
    #[error(
        "body `{body}`: the law \"{law}\" has no twin on the device; use the CPU backend (backend = \"cpu\")"
    )]
    Law {
        /// Name of the body.
        body: String,
        /// Name of the law, or of the part of the body that needs it.
        law: String,
    },
    /// A law that no body says it needs.
    #[error(
        "the law \"{law}\" is active in this world and has no twin on the device; use the CPU backend \
         (backend = \"cpu\")"
    )]
    WorldLaw {
        /// Name of the law.
        law: String,
    },
    /// An integrator that does not run on the device.
    #[error(
        "integrator = \"{integrator}\" does not run on the device: use one of {known}, or the CPU backend \
         (backend = \"cpu\")"
    )]
    Integrator {
        /// As in a scene file.
        integrator: &'static str,
        /// Those that do.
        known: String,
    },
    /// A preconditioner that does not run on the device.
    #[error(
        "preconditioner = \"{preconditioner}\" does not run on the device: use \"auto\", \
         \"block-jacobi\" or \"multigrid\", or the CPU backend (backend = \"cpu\")"
    )]
    Preconditioner {
        /// As in a scene file.
        preconditioner: &'static str,
    },
    /// A buffer that cannot be cut is larger than a shader can see.
    #[error(
        "{what} needs {bytes} bytes in one binding and {adapter} allows {limit}: use a coarser mesh, another \
         adapter or the CPU backend (backend = \"cpu\")"
    )]
    TooLarge {
        /// Which buffer.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The limit.
        limit: u64,
        /// The adapter.
        adapter: String,
    },
    /// The device has no room for a body.
    #[error(
        "{adapter} has too little memory ({reason}): use a coarser mesh, another adapter or the CPU backend \
         (backend = \"cpu\")"
    )]
    OutOfMemory {
        /// The adapter.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// The device stopped answering.
    #[error(
        "{adapter} stopped answering ({reason}): use another adapter or the CPU backend (backend = \"cpu\")"
    )]
    DeviceLost {
        /// The adapter.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
}
