"""Kept records: the same to the last bit, and believed only while what they were made of is the same."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from relight3d.io.files import hash_of
from relight3d.io.stage_file import kept, library_hash
from relight3d.lights import DirectionalLight, PointLight, SpotLight
from relight3d.maths.least_squares import Status
from relight3d.records import Decision, Lobe, TriangleMesh

MESH = TriangleMesh(np.eye(3), np.array([[0, 1, 2]], np.int32), object_names={3: "a box"})
RECORDS = [
    MESH,
    (Lobe(np.ones(3), np.array([-1.0, -1, 1]), 12.5, np.zeros(3)), None, [1, 2.5, "x", True]),
    {("detail", 2): Decision("detail", 2, True, float("inf"), 0.1, "why"), "status": Status.NO_DATA},
    (DirectionalLight((0.3, -0.4, 0.9), (1, 2, 3)), SpotLight((0, 0, 1), (0.1, 0.2, -1), 3.0), np.float32(0.1)),
    None,
]


@pytest.mark.parametrize("record", RECORDS)
def test_a_record_comes_back_to_the_last_bit(tmp_path: Path, record: object) -> None:
    path = tmp_path / "record.npz"
    kept(path, lambda: record, "inputs")
    again = kept(path, lambda: pytest.fail("made anew"), "inputs")
    assert type(again) is type(record) and hash_of(again) == hash_of(record)


def test_other_inputs_make_it_anew(tmp_path: Path) -> None:
    path, calls = tmp_path / "record.npz", []

    def make() -> TriangleMesh:
        calls.append(len(calls))
        return MESH

    for inputs in [(1, MESH), (1, MESH), (2, MESH), (1, MESH)]:
        kept(path, make, *inputs)
    assert calls == [0, 1, 2]  # the second was believed; only the last inputs are kept


def test_other_code_makes_it_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept(tmp_path / "record.npz", lambda: 1)
    monkeypatch.setattr("relight3d.io.stage_file.library_hash", lambda: "other code")
    assert kept(tmp_path / "record.npz", lambda: 2) == 2
    assert len(library_hash()) == 32


@pytest.mark.parametrize("spoil", [lambda data: data[:-30], lambda data: b"", lambda data: b"PK" + data[40:]])
def test_a_damaged_file_is_made_anew(tmp_path: Path, spoil) -> None:
    path = tmp_path / "record.npz"
    kept(path, lambda: MESH)
    path.write_bytes(spoil(path.read_bytes()))
    assert kept(path, lambda: "anew") == "anew"
    assert kept(path, lambda: "once more") == "anew"


def test_a_failure_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        kept(tmp_path / "record.npz", lambda: 1 / 0)
    with pytest.raises(TypeError, match="cannot hold a function"):
        kept(tmp_path / "record.npz", lambda: kept)
    assert list(tmp_path.iterdir()) == []


def test_only_records_of_the_library_are_followed(tmp_path: Path) -> None:
    @dataclass
    class Foreign:
        value: int

    with pytest.raises(TypeError, match="Foreign"):
        kept(tmp_path / "record.npz", lambda: Foreign(1))
    kept(tmp_path / "record.npz", lambda: PointLight((0, 0, 1), (1, 1, 1)))
    with np.load(tmp_path / "record.npz") as file:
        text = file["header"].tobytes().replace(b"relight3d.lights:PointLight", b"subprocess:Popen")
    np.savez(tmp_path / "record.npz", header=np.frombuffer(text, np.uint8))
    assert kept(tmp_path / "record.npz", lambda: "anew") == "anew"
