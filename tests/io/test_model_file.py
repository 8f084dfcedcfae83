"""A model comes back to the last bit, the same model gives the same bytes, and no damage gets past as anything else."""

import dataclasses
import io
import json
import math
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from relight3d.errors import ModelFileError
from relight3d.io.files import hash_of
from relight3d.io.model_file import FORMAT, VERSION, load_model, save_model
from relight3d.records import RelightModel
from tests.io.any_record import any_model, assert_same


@pytest.mark.parametrize("with_optional", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_every_field_comes_back_to_the_last_bit(tmp_path: Path, seed: int, with_optional: bool) -> None:
    model = any_model(seed, with_optional)
    save_model(model, tmp_path / "a.relight")
    loaded = load_model(tmp_path / "a.relight")
    assert_same(model, loaded)
    assert loaded.seconds == {}
    assert hash_of(model) == hash_of(loaded)


def test_settings_keep_their_types(tmp_path: Path) -> None:
    settings = {
        "numbers": (1, 2.5, True, None, math.inf, -math.inf, -0.0, 10**30, 5e-324),
        "nan": math.nan,
        "scalars": [np.float32(0.1), np.int8(-3), np.bool_(True), np.float64("nan")],
        "nested": {"$tuple": {"": []}, "a.b": np.zeros(0), "a": {"b": np.ones((2, 0, 3), np.int8)}},
        "arrays": (np.float64(3).reshape(()), np.zeros(3, ">f4"), np.arange(6).reshape(2, 3).T),
        "words": "line\nbreak \0 \ud800 ünï",
    }
    model = dataclasses.replace(any_model(), settings=settings)
    save_model(model, tmp_path / "a.relight")
    assert_same(model.settings, load_model(tmp_path / "a.relight").settings)


def test_the_same_model_gives_the_same_bytes(tmp_path: Path) -> None:
    model = any_model()
    model.mesh.face_normals, model.mesh.center  # noqa: B018 - cached on the record, and no part of the file
    timed = dataclasses.replace(any_model(), seconds={"recover": 12.5})
    paths = [tmp_path / name for name in ("a", "b", "c")]
    save_model(model, paths[0])
    save_model(timed, paths[1])
    save_model(load_model(paths[0]), paths[2])
    assert paths[0].read_bytes() == paths[1].read_bytes() == paths[2].read_bytes()
    save_model(any_model(seed=1), paths[1])
    assert paths[0].read_bytes() != paths[1].read_bytes()


def test_the_model_saves_itself_and_numpy_can_read_it(tmp_path: Path) -> None:
    model = any_model()
    model.save(tmp_path / "a.relight")
    with np.load(tmp_path / "a.relight") as file:
        np.testing.assert_array_equal(file["pixels.albedo"], model.pixels.albedo)


def test_what_shrinks_is_packed(tmp_path: Path) -> None:
    model = any_model()
    flat = dataclasses.replace(
        model, settings={"flat": np.zeros(1_000_000), "noise": np.random.default_rng(0).random(9999)}
    )
    save_model(flat, tmp_path / "a.relight")
    with zipfile.ZipFile(tmp_path / "a.relight") as file:
        assert file.getinfo("settings.flat.npy").compress_size < 100_000
        assert file.getinfo("settings.noise.npy").compress_type == zipfile.ZIP_STORED
    assert_same(flat.settings, load_model(tmp_path / "a.relight").settings)


def test_what_is_no_data_is_our_own_mistake(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match=r"settings\.solver, a builtin_function_or_method"):
        save_model(dataclasses.replace(any_model(), settings={"solver": len}), tmp_path / "a.relight")
    assert not list(tmp_path.iterdir())


# -------------------------------------------------------------------------------------- damaged and foreign


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> tuple[RelightModel, bytes]:
    path = tmp_path_factory.mktemp("model") / "a.relight"
    save_model(any_model(), path)
    return any_model(), path.read_bytes()


def refused(path: Path) -> str:
    """The one line a file is refused with."""
    with pytest.raises(ModelFileError) as caught:
        load_model(path)
    assert str(caught.value).startswith(f"{path}: got ") and "\n" not in str(caught.value)
    return str(caught.value)


def test_a_cut_file_is_refused_wherever_it_is_cut(tmp_path: Path, saved: tuple[RelightModel, bytes]) -> None:
    path, whole = tmp_path / "a.relight", saved[1]
    for length in [0, 1, 4, 30, *range(60, len(whole), len(whole) // 60), len(whole) - 1]:
        path.write_bytes(whole[:length])
        refused(path)


def test_a_flipped_byte_is_refused_or_harmless(tmp_path: Path, saved: tuple[RelightModel, bytes]) -> None:
    path, (model, whole) = tmp_path / "a.relight", saved
    random = np.random.default_rng(5)
    # The directory at the end is where a flip does the strangest things: look at all of its first and last bytes.
    directory = whole.index(b"PK\x01\x02")
    places = [
        *random.integers(0, len(whole), 150),
        *range(directory, directory + 120),
        *range(len(whole) - 60, len(whole)),
    ]
    num_refused = 0
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(random.integers(8))
        path.write_bytes(damaged)
        try:
            assert_same(model, load_model(path))  # a date in the directory, say
        except ModelFileError:
            num_refused += 1
    assert num_refused > len(places) // 2


def repacked(saved: tuple[RelightModel, bytes], name: str, content: bytes) -> bytes:
    """The file with one member's content replaced: whole as a zip, and wrong inside."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(saved[1])) as old, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as new:
        for member in old.namelist():
            new.writestr(member, content if member == name else old.read(member))
    return stream.getvalue()


def npy_header(shape: str, descr: str = "'<f4'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def test_an_array_that_lies_about_its_size_is_not_allocated(tmp_path: Path, saved: tuple[RelightModel, bytes]) -> None:
    path = tmp_path / "a.relight"
    lies = [
        npy_header("(1000000, 1000000)"),
        npy_header("(-1, 3)"),
        npy_header("(2, 3)", "'|O'"),
        npy_header("(2,"),
        b"npy",
    ]
    for lie in lies:
        path.write_bytes(repacked(saved, "pixels.albedo.npy", lie + b"\0" * 24))
        tracemalloc.start()
        refused(path)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 10_000_000


def with_model(change) -> bytes:
    header = {"format": FORMAT, "version": VERSION, "model": {"$record": "RelightModel"}}
    return json.dumps(change(header)).encode()


HEADERS = [
    (with_model(lambda h: h | {"version": 99}), "a model of version 99, expected version 1"),
    (with_model(lambda h: h | {"format": "other"}), "a zip of another kind"),
    (with_model(lambda h: []), "a zip of another kind"),
    (with_model(lambda h: h), "missing"),
    (with_model(lambda h: h | {"model": {"$record": "Popen"}}), "Popen"),
    (with_model(lambda h: h | {"model": {"$record": "Decision", "effect": 1}}), "missing"),
    (with_model(lambda h: h | {"model": {"$scalar": "O", "value": 1}}), "damaged or foreign"),
    (with_model(lambda h: h | {"model": 3}), "a int instead of a RelightModel"),
    (b"{", "damaged or foreign"),
    (b"[" * 100_000, "damaged or foreign"),
    (b"\xff", "damaged or foreign"),
]


@pytest.mark.parametrize(("header", "words"), HEADERS, ids=range(len(HEADERS)))
def test_a_header_of_another_kind_is_refused(
    tmp_path: Path, saved: tuple[RelightModel, bytes], header: bytes, words: str
) -> None:
    path = tmp_path / "a.relight"
    path.write_bytes(repacked(saved, "model.json", header))
    assert words in refused(path)


def test_what_is_no_model_file_is_refused(tmp_path: Path) -> None:
    assert "no such file" in refused(tmp_path / "none.relight")
    assert "no such file" in refused(tmp_path)  # a folder
    for content in (b"", b"hello", b"PK\x03\x04", b"PK\x05\x06" + b"\0" * 18):
        (tmp_path / "a.relight").write_bytes(content)
        refused(tmp_path / "a.relight")
