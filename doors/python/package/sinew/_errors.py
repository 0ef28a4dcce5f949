"""Exceptions; their texts are those of the engine."""

from __future__ import annotations


class Error(Exception):
    """Anything that the engine refuses. ``index`` is the place in a batch, if it comes from one."""

    index: int | None = None


class ArgumentError(Error, ValueError):
    """An argument that cannot be used."""


class MeshError(Error):
    """A mesh that cannot be used."""


class MaterialError(Error):
    """A material that cannot be used."""


class SceneError(Error):
    """A scene that cannot be used; the text names file, line and key."""


class StepError(Error):
    """A step that could not be carried out. The state is that before it.

    ``step`` is the number of steps done before, ``time`` (s) the time at which it began.
    """

    step: int
    time: float

    def __init__(self, text: str, step: int = 0, time: float = 0.0) -> None:
        super().__init__(text)
        self.step = step
        self.time = time

    def __str__(self) -> str:
        return str(self.args[0])

    def __reduce__(self) -> tuple[type[StepError], tuple[str, int, float]]:
        return type(self), (str(self), self.step, self.time)


class BackendError(Error):
    """The machine or the build does not have what was asked for."""


class FileError(Error, OSError):
    """A file that cannot be read."""


class SnapshotError(Error):
    """A snapshot that cannot be read or does not fit."""


class HandleError(Error, LookupError):
    """A body, tool or other thing that was removed, or belongs to another simulation."""


class Panic(Error):
    """The engine failed in itself. The simulation refuses every call from then on; others are as they were."""


_CODES: dict[int, type[Error]] = {
    1: ArgumentError,
    2: MeshError,
    3: MaterialError,
    4: SceneError,
    5: StepError,
    6: BackendError,
    7: FileError,
    8: SnapshotError,
    9: HandleError,
    99: Panic,
}


def make(code: int, text: str, at: tuple[int, float] | None = None) -> Error:
    """The exception of a code of the engine."""
    if code == 5 and at is not None:
        return StepError(text, *at)
    return _CODES.get(code, Error)(text)
