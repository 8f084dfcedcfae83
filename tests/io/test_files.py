"""Nothing is ever half written, and a hash changes exactly when content does."""

import signal
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from relight3d.errors import InputError
from relight3d.io.files import atomic_path, hash_of, write_json, write_text


def test_a_file_appears_whole_with_its_folders(tmp_path: Path) -> None:
    target = tmp_path / "made" / "on the way" / "a.txt"
    with atomic_path(target) as temporary:
        assert temporary.parent == target.parent and temporary.suffix == ".txt"
        temporary.write_text("whole")
        assert not target.exists()
    assert target.read_text() == "whole"
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(error), atomic_path(target) as temporary:
        temporary.write_text("ne")
        raise error
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_killed_process_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    script = (
        "import os, signal, sys\n"
        "from relight3d.io.files import atomic_path\n"
        "with atomic_path(sys.argv[1]) as temporary:\n"
        "    temporary.write_text('ne')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    root = Path(__file__).parents[2]
    killed = subprocess.run([sys.executable, "-c", script, str(target)], cwd=root, timeout=60)
    assert killed.returncode == -signal.SIGKILL
    assert target.read_text() == "old"


def test_a_link_is_written_through(tmp_path: Path) -> None:
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to(tmp_path / "real.txt")
    write_text(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text() == "new"


def test_a_file_is_as_readable_as_any_other(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    write_text(tmp_path / "atomic", "")
    assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("name", ["", "file.txt/below.txt"])
def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "file.txt").write_text("")
    with pytest.raises(InputError, match=f"^{tmp_path}"):
        write_text(tmp_path / name, "x")


def test_json_refuses_nan(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", float("nan"))
    assert not list(tmp_path.iterdir())


# ---------------------------------------------------------------------------------------------- hash_of


@dataclass(frozen=True)
class Options:
    degree: int = 2
    name: str = "hsh"
    folder: Path = Path(".")
    seconds: float = field(default=0.0, compare=False)


DIFFERENT = [
    (1, 1.0),
    (True, 1),
    ("1", 1),
    (None, "None"),
    (("ab", "c"), ("a", "bc")),
    ((1, (2, 3)), ((1, 2), 3)),
    (np.zeros(4, np.float32), np.zeros(4)),
    (np.zeros((2, 2)), np.zeros(4)),
    ({"a": 1}, {"a": 2}),
    (Options(), Options(degree=3)),
    (Options(), {"degree": 2, "name": "hsh"}),
]


@pytest.mark.parametrize(("a", "b"), DIFFERENT)
def test_what_differs_hashes_differently(a: object, b: object) -> None:
    assert hash_of(a) != hash_of(b)


EQUAL = [
    ({"a": 1, "b": 2}, {"b": 2, "a": 1}),
    (np.arange(6).reshape(2, 3).T, np.ascontiguousarray(np.arange(6).reshape(2, 3).T)),
    (np.float64(0.5), 0.5),
    (Options(seconds=1.0), Options(seconds=2.0)),
    (Options(folder=Path("/tmp")), Options(folder=Path("/"))),
    ([1, 2], (1, 2)),
]


@pytest.mark.parametrize(("a", "b"), EQUAL)
def test_what_is_equal_hashes_alike(a: object, b: object) -> None:
    assert hash_of(a) == hash_of(b)


def test_the_hash_is_stable_across_versions() -> None:
    # A changed constant throws every user's stage cache away: change it knowingly.
    assert hash_of("desk", 2, Options(), np.arange(3, dtype=np.int32)) == "79e9acdc0e390368af91ec8e16d0eeea"


def test_a_path_stands_for_its_content(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "x.bin").write_bytes(b"1")
    (tmp_path / "copy.bin").write_bytes(b"1")
    assert hash_of(tmp_path / "a" / "x.bin") == hash_of(tmp_path / "copy.bin")
    before = hash_of(tmp_path / "a")
    (tmp_path / "a" / "x.bin").write_bytes(b"2")
    changed = hash_of(tmp_path / "a")
    (tmp_path / "a" / "x.bin").rename(tmp_path / "a" / "y.bin")
    assert len({before, changed, hash_of(tmp_path / "a")}) == 3


def test_what_has_no_content_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"missing.bin"):
        hash_of(tmp_path / "missing.bin")
    for part in (len, object(), np.array([None])):
        with pytest.raises(TypeError, match="hash_of"):
            hash_of(part)
