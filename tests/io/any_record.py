"""A record of any class of records.py, filled in from its annotations, so that no field is forgotten by a test."""

import dataclasses
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from relight3d import records
from relight3d.camera import Camera, look_at
from relight3d.lights import DirectionalLight, PointLight, RectangleLight, SphereLight, SpotLight

CAMERA = Camera(8, 6, 9.5, 9.25, 4.1, 2.9, 0.01, -0.002, 1e-4, 2e-4, look_at(np.array([1.0, 2.0, 3.0]), np.zeros(3)))
LIGHTS = (
    DirectionalLight((0.3, -0.4, 0.9), (3.0, 2.0, 1.0)),
    PointLight((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)),
    SpotLight((1.0, 2.0, 3.0), (0.1, 0.2, -1.0), (4.0, 5.0, 6.0), 0.25, 0.75),
    SphereLight((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), radius=0.1),
    RectangleLight((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), edge_u=(0.0, 1.0, 0.0), edge_v=(0.0, 0.0, 1.0)),
)


def any_record(cls: type, random: np.random.Generator, with_optional: bool = True) -> Any:
    """An instance with random content; what may be None is None unless `with_optional`."""
    if cls is Camera:
        return CAMERA
    hints = typing.get_type_hints(cls)
    return cls(**{f.name: any_value(hints[f.name], random, with_optional) for f in dataclasses.fields(cls)})


def any_value(hint: Any, random: np.random.Generator, with_optional: bool) -> Any:
    """A value of an annotated type."""
    if hint is object:
        return random.choice([1, 2.5, True, "text"]).item()
    if hasattr(hint, "dim_str"):  # jaxtyping's arrays
        # A number is a length; a name stands for the same one everywhere.
        shape = tuple(int(axis) if axis.isdecimal() else 2 + len(axis) % 3 for axis in hint.dim_str.split())
        dtype = np.dtype(hint.dtypes[0])
        if dtype.kind == "f":
            return random.normal(0.0, 1.0, shape).astype(dtype)
        return random.integers(0, 2, shape).astype(dtype)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if types.NoneType in arguments and not with_optional:
            return None
        if DirectionalLight in arguments:
            return LIGHTS[random.integers(len(LIGHTS))]
        return any_value(next(a for a in arguments if a is not types.NoneType), random, with_optional)
    if origin is typing.Literal:
        return arguments[random.integers(len(arguments))]
    if origin is tuple:
        members = arguments[:1] * 2 if arguments[-1] is Ellipsis else arguments
        return tuple(any_value(member, random, with_optional) for member in members)
    if origin is not None and issubclass(origin, Mapping):
        return {any_value(arguments[0], random, True): any_value(arguments[1], random, with_optional) for _ in range(2)}
    if dataclasses.is_dataclass(hint):
        return any_record(typing.cast(type, hint), random, with_optional)
    makers = {
        int: lambda: int(random.integers(-5, 5)),
        float: lambda: float(random.normal()),
        bool: lambda: bool(random.integers(2)),
        str: lambda: f"word {random.integers(100)} µ.$",
        Path: lambda: Path("somewhere"),
    }
    return makers[hint]()


def any_model(seed: int = 0, with_optional: bool = True) -> records.RelightModel:
    """A RelightModel of random content in every field."""
    return any_record(records.RelightModel, np.random.default_rng(seed), with_optional)


def assert_same(a: Any, b: Any, where: str = "") -> None:
    """Same types and, to the last bit, same values, all the way down; fields declared compare=False may differ."""
    assert type(a) is type(b), where
    if isinstance(a, np.ndarray):
        assert a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes(), where
        assert b.flags.writeable and b.flags.c_contiguous, where
    elif dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            if field.compare:
                assert_same(getattr(a, field.name), getattr(b, field.name), f"{where}.{field.name}")
    elif isinstance(a, Mapping):
        assert list(a) == list(b), where
        for key in a:
            assert_same(a[key], b[key], f"{where}[{key!r}]")
    elif isinstance(a, tuple | list):
        assert len(a) == len(b), where
        for index, (x, y) in enumerate(zip(a, b)):
            assert_same(x, y, f"{where}[{index}]")
    else:
        assert repr(a) == repr(b), where  # NaN, and -0.0, by their names
