"""The tiny desk, a model of it, and a way to run the command line."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from relight3d.cli import main
from tests.commands.asserts import QUICK, TINY


@pytest.fixture(scope="session")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of the tiny desk, recovered once and in haste."""
    path = tmp_path_factory.mktemp("model") / "tiny.relight"
    assert main(["recover", str(TINY), "-o", str(path), "--quiet", *QUICK]) == 0
    return path


@pytest.fixture
def tiny_copy(tmp_path: Path) -> Path:
    """A copy of the tiny desk, free to be spoilt."""
    return Path(shutil.copytree(TINY, tmp_path / "tiny", ignore=shutil.ignore_patterns("truth")))


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Runs a command and gives its status and what it wrote to standard output and error."""

    def run_(*arguments: object) -> tuple[int, str, str]:
        capsys.readouterr()
        status = main([str(argument) for argument in arguments])
        written = capsys.readouterr()
        return status, written.out, written.err

    return run_
