"""A desk whose model is known, with its capture: what most tests of the display look at."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.display.subject import Subject
from relight3d.evaluate.truth import true_model
from relight3d.maths.least_squares import Status
from relight3d.records import Capture, Decision, Health, RelightModel
from tests.scenes import desk, desk_capture

NUM_LIGHTS = 6


@pytest.fixture(scope="session")
def capture() -> Capture:
    """Checkered table, box, glossy sphere, mirror board: without interreflections, so that the true model is exact."""
    return desk_capture(NUM_LIGHTS, glossy=True, textured=True, mirror=True, ambient=0.2, bounce=False)


@pytest.fixture(scope="session")
def model(capture: Capture) -> RelightModel:
    """The true model of the capture, with decisions and the health of two families of fits."""
    lights = [photograph.lights for photograph in capture.split("train")]
    found = true_model(desk(glossy=True, textured=True, mirror=True, ambient=0.2), lights, exposure=0.6)
    num_faces, num_surfaces = len(found.mesh.faces), found.surfaces.num_surfaces
    status = np.full(num_faces, Status.OK, np.int8)
    status[: num_faces // 2] = Status.NO_DATA
    indirect = _health("face", status, np.where(status == Status.OK, 10.0, np.inf), "the nearest face")
    lobes = _health("surface", np.full(num_surfaces, Status.OK, np.int8), np.full(num_surfaces, 100.0), "")
    decisions = (
        Decision("shadows", -1, True, 8.0, 0.5, "photographs show them"),
        Decision("lobes", 2, True, 1.5, 0.2, "left-out photographs gain"),
        Decision("lobes", 0, False, 0.0, 0.2, "no gain"),
    )
    return replace(found, health={"indirect": indirect, "lobes": lobes}, decisions=decisions, warnings=("a warning",))


@pytest.fixture(scope="session")
def subject(model: RelightModel, capture: Capture) -> Subject:
    return Subject(model, capture)


def _health(site: str, status: np.ndarray, condition: np.ndarray, fallback: str) -> Health:
    rank = np.where(status == Status.OK, 4, 0).astype(np.int32)
    return Health(site, status, rank, condition.astype(np.float32), np.zeros(len(status), np.float32), fallback)
