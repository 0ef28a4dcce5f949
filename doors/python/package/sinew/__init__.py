"""Sinew: soft tissue in Python.

>>> import sinew
>>> mesh = sinew.generate("box", size=(0.1, 0.1, 0.05), cells=(4, 4, 2))
>>> sim = sinew.Simulation(dt=0.01, threads=1)
>>> block = sim.add_body("block", mesh, sinew.preset("liver"))
>>> floor = sim.hold(block, "z0")
>>> sim.step(20)
>>> bool(floor.reaction[2] > 0)
True

SI units. Arrays are in the order of the user's mesh.
"""

from typing import Any

from . import _native
from ._errors import (
    ArgumentError,
    BackendError,
    Error,
    FileError,
    HandleError,
    MaterialError,
    MeshError,
    Panic,
    SceneError,
    SnapshotError,
    StepError,
)
from ._native import HapticDevice, HapticFeedback, Snapshot
from ._mesh import Mesh, generate, read_mesh
from ._reports import (
    ContactFigures,
    ContactReport,
    Cut,
    Fallbacks,
    GlueReport,
    PartReport,
    PullReport,
    Removal,
    Report,
    TearReport,
    ThreadReport,
    ToolReport,
    Volume,
)
from ._simulation import (
    Batch,
    Body,
    Clip,
    Constraint,
    Contact,
    Haptic,
    HeldTool,
    Load,
    Page,
    Pressure,
    Pull,
    Reader,
    Simulation,
    Thread,
    Tool,
)
from ._types import (
    Axes,
    Box,
    Capsule,
    Energy,
    Family,
    Field,
    HalfSpace,
    Material,
    Membrane,
    Muscle,
    Part,
    Pick,
    Pose,
    Run,
    Sine,
    Skin,
    Sphere,
    Stiffness,
    Warning,
    Wrench,
    asdict,
    preset,
)


def build_info() -> dict[str, Any]:
    """What was built: version, machine, instruction sets, whether with a graphics processor."""
    return _native.build_info()


__version__: str = str(build_info()["version"])

__all__ = [
    "ArgumentError",
    "Axes",
    "BackendError",
    "Batch",
    "Body",
    "Box",
    "Capsule",
    "Clip",
    "Constraint",
    "Contact",
    "ContactFigures",
    "ContactReport",
    "Cut",
    "Energy",
    "Error",
    "Fallbacks",
    "Family",
    "Field",
    "FileError",
    "HalfSpace",
    "HandleError",
    "Haptic",
    "HeldTool",
    "HapticDevice",
    "HapticFeedback",
    "Load",
    "Material",
    "MaterialError",
    "Membrane",
    "Mesh",
    "MeshError",
    "Muscle",
    "Page",
    "Panic",
    "Part",
    "PartReport",
    "Pick",
    "Pose",
    "Pressure",
    "Pull",
    "PullReport",
    "Reader",
    "Removal",
    "Report",
    "Run",
    "SceneError",
    "Simulation",
    "Sine",
    "Skin",
    "Snapshot",
    "SnapshotError",
    "Sphere",
    "StepError",
    "Stiffness",
    "TearReport",
    "Thread",
    "ThreadReport",
    "Tool",
    "ToolReport",
    "Volume",
    "Warning",
    "Wrench",
    "asdict",
    "build_info",
    "generate",
    "preset",
    "read_mesh",
]
