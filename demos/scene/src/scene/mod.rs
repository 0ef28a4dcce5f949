//! What a scene file may hold, and reading it. Every key is described in `demos/scenes/README.md`; an unknown
//! key is an error with a hint. SI units throughout, angles in degrees. Nothing here knows how a scene is
//! built.

mod body;
mod conditions;
mod document;
mod fibres;
mod mistakes;
mod read;
mod resection;
mod shape;
mod thread;
mod touch;

pub use body::{BodyEntry, MaterialEntry, MembraneEntry, SpringMethod, TearEntry};
pub use conditions::{
    BoxRegion, ConstraintEntry, CurveEntry, CylinderRegion, FacesEntry, HalfSpaceRegion, LoadEntry,
    MotionEntry, PatchRegion, PressureEntry, RotationAbout, Selection, Sine, SphereRegion,
};
pub use document::{BackendName, ExecutorName, Mode, Output, PrecisionName, ProbeEntry, Scene};
pub use fibres::{
    AngleEntry, AxesEntry, AzimuthElevationEntry, CircularEntry, FibreEntry, HelicoidalEntry,
    HemicircularEntry, LaplaceEntry, MuscleEntry, RandomEntry,
};
pub use read::LoadedScene;
pub(crate) use read::{Key, PreparedMesh};
pub use resection::{CutEntry, CutterEntry, ResectionEntry};
pub use shape::{
    BalloonShape, BoxShape, CupShape, CylinderShape, DiscShape, Generate, Rotation, SHAPES,
    ShapeDocument, ShapeKey, SheetCells, SheetShape, SolidCells, SpecimenShape, SphereShape,
};
pub use thread::{ClipEntry, ThreadEntry};
pub use touch::{
    ContactEntry, EdgeEntry, FlanksEntry, NeedleEntry, PartEntry, PullEntry, ToolEntry, ToolShape,
    TouchedEntry,
};
