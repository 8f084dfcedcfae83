"""The lights of a capture and of a frame, in the units of the contract.

A light answers one question: from which direction, and with how much irradiance on a facing surface, does it
arrive at these points? A directional light is its own answer; a point light falls off with the squared distance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from relight3d.errors import InputError

Vector = Sequence[float | int] | np.ndarray  # three numbers; kept as a tuple of floats
Color = Vector | float | int | np.number  # three numbers, or one for grey

FAR = 1e30  # the distance of a directional light: beyond every scene, and finite


class Incident(NamedTuple):
    """What arrives at each point: the unit direction to the light, facing irradiance (rgb), distance."""

    to_light: np.ndarray
    irradiance: np.ndarray
    distance: np.ndarray


@dataclass(frozen=True, eq=False)
class DirectionalLight:
    """A light at infinity: `irradiance` (rgb or a number for grey) on a surface that faces it."""

    to_light: Vector
    irradiance: Color

    kind = "directional"

    def __post_init__(self) -> None:
        object.__setattr__(self, "to_light", _floats(_unit("to_light", self.to_light)))
        object.__setattr__(self, "irradiance", _floats(_color("irradiance", self.irradiance)))

    @property
    def power(self) -> Float[np.ndarray, "3"]:
        """The colour that scales everything this light does."""
        return np.array(self.irradiance)

    def scaled(self, factor: Color) -> "DirectionalLight":
        """The same light, brighter or coloured by `factor`."""
        return replace(self, irradiance=tuple(self.power * factor))

    def translated(self, offset: np.ndarray) -> "DirectionalLight":
        """A light at infinity does not move."""
        return self

    def incident(self, points: Float[np.ndarray, "point 3"]) -> Incident:
        """Direction, irradiance and distance at the points; the arrays are broadcast views."""
        shape = (len(points), 3)
        return Incident(
            np.broadcast_to(np.asarray(self.to_light, points.dtype), shape),
            np.broadcast_to(np.asarray(self.irradiance, points.dtype), shape),
            np.broadcast_to(np.asarray(FAR, points.dtype), shape[:1]),
        )

    def to_dict(self) -> dict:
        return {"type": self.kind, "to_light": list(self.to_light), "irradiance": self.power.tolist()}


@dataclass(frozen=True, eq=False)
class PointLight:
    """A small lamp: irradiance = intensity * cos / distance^2."""

    position: Vector
    intensity: Color

    kind = "point"

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _floats(_vector("position", self.position)))
        object.__setattr__(self, "intensity", _floats(_color("intensity", self.intensity)))

    @property
    def power(self) -> Float[np.ndarray, "3"]:
        """The colour that scales everything this light does."""
        return np.array(self.intensity)

    def scaled(self, factor: Color) -> "PointLight":
        """The same light, brighter or coloured by `factor`."""
        return replace(self, intensity=tuple(self.power * factor))

    def translated(self, offset: np.ndarray) -> "PointLight":
        """The light moved by `offset`."""
        return replace(self, position=tuple(np.asarray(self.position) + offset))

    def incident(self, points: Float[np.ndarray, "point 3"]) -> Incident:
        """Direction, irradiance and distance at the points. At the lamp itself the direction is zero: it lights nothing."""
        offset = np.asarray(self.position, points.dtype) - points
        squared = np.einsum("ij,ij->i", offset, offset)
        tiny = np.finfo(points.dtype).tiny
        distance = np.sqrt(squared)
        to_light = offset / np.maximum(distance, np.sqrt(tiny))[:, None]
        falloff = np.where(squared > tiny, 1.0 / np.maximum(squared, tiny), 0.0) * self.cone(to_light)
        return Incident(to_light, falloff[:, None] * np.asarray(self.intensity, points.dtype), distance)

    def cone(self, to_light: np.ndarray) -> np.ndarray | float:
        """How much of the intensity goes each way; `to_light` points from the surface to the lamp."""
        return 1.0

    def to_dict(self) -> dict:
        return {"type": self.kind, "position": list(self.position), "intensity": self.power.tolist()}


@dataclass(frozen=True, eq=False)
class SpotLight(PointLight):
    """A point light with a cone about `direction` (where it shines to), smooth between the two angles.

    Falloff as glTF KHR_lights_punctual: the square of a clamped linear ramp in the cosine.
    """

    direction: Vector = (0.0, 0.0, -1.0)
    inner_cone_angle: float = 0.0
    outer_cone_angle: float = np.pi / 4

    kind = "spot"

    def __init__(  # the contract's order of arguments: direction before intensity
        self,
        position: Vector,
        direction: Vector,
        intensity: Color,
        inner_cone_angle: float = 0.0,
        outer_cone_angle: float = np.pi / 4,
    ) -> None:
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "intensity", intensity)
        super().__post_init__()
        object.__setattr__(self, "direction", _floats(_unit("direction", direction)))
        inner, outer = float(inner_cone_angle), float(outer_cone_angle)
        if not 0.0 <= inner <= outer <= np.pi or outer == 0.0:
            raise InputError(
                "inner_cone_angle, outer_cone_angle", (inner, outer), "0 <= inner <= outer <= pi (radians), outer > 0"
            )
        object.__setattr__(self, "inner_cone_angle", inner)
        object.__setattr__(self, "outer_cone_angle", outer)

    def scaled(self, factor: Color) -> "SpotLight":
        """The same light, brighter or coloured by `factor`."""
        return self.moved(intensity=tuple(self.power * factor))

    def translated(self, offset: np.ndarray) -> "SpotLight":
        """The light moved by `offset`."""
        return self.moved(position=tuple(np.asarray(self.position) + offset))

    def moved(self, **changes) -> "SpotLight":
        """The same light with some of its arguments changed (dataclasses.replace cannot: the order is the contract's)."""
        names = ("position", "direction", "intensity", "inner_cone_angle", "outer_cone_angle")
        return SpotLight(**{**{name: getattr(self, name) for name in names}, **changes})

    def cone(self, to_light: np.ndarray) -> np.ndarray:
        cosine = -to_light @ np.asarray(self.direction, to_light.dtype)
        inner, outer = np.cos(self.inner_cone_angle), np.cos(self.outer_cone_angle)
        # Equal angles make a hard edge: the ramp is given a width of 1e-3 in the cosine, as glTF advises.
        return np.clip((cosine - outer) / max(inner - outer, 1e-3), 0.0, 1.0) ** 2

    def to_dict(self) -> dict:
        return super().to_dict() | {
            "direction": list(self.direction),
            "inner_cone_angle": self.inner_cone_angle,
            "outer_cone_angle": self.outer_cone_angle,
        }


@dataclass(frozen=True, eq=False)
class SphereLight(PointLight):
    """A glowing ball: a point light at a distance, with soft shadows near it. `intensity` as of the point light."""

    radius: float = 0.0

    kind = "sphere"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise InputError("radius", self.radius, "a positive radius in the capture's unit")

    def samples(self, num: int, seed: int = 0) -> list[PointLight]:
        """Point lights spread evenly over the ball's surface (a spiral, turned by the seed), one share each."""
        index = np.arange(num) + 0.5
        z = 1.0 - 2.0 * index / num
        azimuth = np.pi * (1.0 + 5.0**0.5) * index + 2.399963 * seed
        ring = np.sqrt(np.maximum(0.0, 1.0 - z * z))
        offsets = self.radius * np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
        return [PointLight(tuple(np.asarray(self.position) + o), tuple(self.power / num)) for o in offsets]

    def to_dict(self) -> dict:
        return super().to_dict() | {"radius": self.radius}


@dataclass(frozen=True, eq=False)
class RectangleLight(PointLight):
    """A glowing panel about `position`, spanned by two edge vectors, shining to the side of edge_u x edge_v.

    `intensity` is that along its normal; to other directions it falls with the cosine.
    """

    edge_u: Vector = (1.0, 0.0, 0.0)
    edge_v: Vector = (0.0, 1.0, 0.0)

    kind = "rectangle"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "edge_u", _floats(_vector("edge_u", self.edge_u)))
        object.__setattr__(self, "edge_v", _floats(_vector("edge_v", self.edge_v)))
        if np.linalg.norm(np.cross(self.edge_u, self.edge_v)) == 0.0:
            raise InputError("edge_u, edge_v", (self.edge_u, self.edge_v), "two edges that span an area")

    def samples(self, num: int, seed: int = 0) -> list["RectangleSample"]:
        """Small panels on a jittered lattice over the rectangle, one share of the intensity each."""
        columns = max(1, round(num**0.5))
        rows = max(1, num // columns)
        jitter = np.random.default_rng(seed).random((rows, columns, 2))
        v, u = (np.mgrid[0:rows, 0:columns] + 0.0).reshape(2, -1)
        u = (u + jitter[..., 0].ravel()) / columns - 0.5
        v = (v + jitter[..., 1].ravel()) / rows - 0.5
        normal = np.cross(self.edge_u, self.edge_v)
        places = np.asarray(self.position) + u[:, None] * np.asarray(self.edge_u) + v[:, None] * np.asarray(self.edge_v)
        share = tuple(self.power / len(places))
        return [RectangleSample(tuple(p), share, normal=tuple(normal / np.linalg.norm(normal))) for p in places]

    def to_dict(self) -> dict:
        return super().to_dict() | {"edge_u": list(self.edge_u), "edge_v": list(self.edge_v)}


@dataclass(frozen=True, eq=False)
class RectangleSample(PointLight):
    """One share of a panel: a point light that falls with the cosine to the panel's normal."""

    normal: Vector = (0.0, 0.0, 1.0)

    def cone(self, to_light: np.ndarray) -> np.ndarray:
        return np.maximum(0.0, -to_light @ np.asarray(self.normal, to_light.dtype))


Light = DirectionalLight | PointLight | SpotLight | SphereLight | RectangleLight
LIGHT_TYPES: dict[str, type] = {
    cls.kind: cls for cls in (DirectionalLight, PointLight, SpotLight, SphereLight, RectangleLight)
}


def light_from_dict(entry: object, field: str = "light") -> Light:
    """One light of transforms.json or LIGHTS.json. Raises InputError naming `field` and the key at fault."""
    if not isinstance(entry, dict):
        raise InputError(field, entry, 'an object such as {"type": "directional", ...}')
    kind = entry.get("type")
    if kind not in LIGHT_TYPES:
        raise InputError(f"{field}.type", kind, f"one of {', '.join(LIGHT_TYPES)}")
    arguments = {key: value for key, value in entry.items() if key != "type"}
    try:
        return LIGHT_TYPES[kind](**arguments)
    except InputError as error:
        raise InputError(f"{field}.{error.field}", error.got, error.expected, error.hint) from None
    except TypeError as error:
        raise InputError(field, error, f"the keys of a {kind} light") from None


def _floats(vector: np.ndarray) -> tuple[float, ...]:
    return tuple(float(x) for x in vector)


def _vector(name: str, value: object) -> Float[np.ndarray, "3"]:
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(name, value, "three numbers") from None
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(name, value, "three finite numbers")
    return vector


def _unit(name: str, value: object) -> Float[np.ndarray, "3"]:
    vector = _vector(name, value)
    length = np.linalg.norm(vector)
    if length == 0.0:
        raise InputError(name, value, "a direction that is not zero")
    return vector / length


def _color(name: str, value: object) -> Float[np.ndarray, "3"]:
    number = isinstance(value, int | float | np.number)
    color = _vector(name, [value] * 3 if number else value)
    if (color < 0).any():
        raise InputError(name, value, "no negative component")
    return color
