"""A fresh copy of the tiny valid capture folder for each test."""

import copy
from pathlib import Path

import pytest

from tests.io.folders import CaptureFolder, make_capture_folder


@pytest.fixture(scope="session")
def _master(tmp_path_factory: pytest.TempPathFactory) -> CaptureFolder:
    return make_capture_folder(tmp_path_factory.mktemp("master"))


@pytest.fixture
def capture_folder(_master: CaptureFolder, tmp_path: Path) -> CaptureFolder:
    """A copy of the valid folder, free to be spoilt."""
    for file in ("mask.png", "mesh.ply", *(f"images/{index}.png" for index in range(4))):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_bytes((_master.path / file).read_bytes())
    return CaptureFolder(tmp_path, copy.deepcopy(_master.top))
