"""What several tests build."""

import os
from pathlib import Path

import pytest
import sinew

ROOT = Path(os.environ.get("SINEW_REPOSITORY", Path(__file__).resolve().parents[3]))
SCENES = ROOT / "demos" / "scenes"


def block(cells=(6, 6, 4), threads=1, **options):
    """A soft block on the floor, and its simulation."""
    mesh = sinew.generate("box", size=(0.1, 0.1, 0.06), cells=cells)
    sim = sinew.Simulation(dt=0.01, threads=threads, **options)
    body = sim.add_body("block", mesh, sinew.preset("liver"))
    sim.hold(body, "z0")
    return sim, body


@pytest.fixture
def small():
    return block((2, 2, 2))


def pytest_report_header(config):
    return f"sinew {sinew.__version__} from {sinew.__file__}, {sinew.build_info()}"


