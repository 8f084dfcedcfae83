"""How well the predicted shading explains the photographs, as the capture is given and as it may have been meant.

One score: the correlation, over the photographs, of a point's radiance with the light that geometry says it gets (lit or
in shadow, cosine, falloff), and of all points the middle one, so that mirrors and gloss have no vote while they are few.
Both are put under a root: a highlight of a hundred times white is no outlier. An albedo, constant light and one exposure for
all drop out. Good captures score 0.88 to 0.99; lights of another frame 0.5 or less, a focal length 20 % off 0.5 to 0.8.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64

from relight3d.camera import Camera
from relight3d.lights import DirectionalLight, Light, RectangleLight, SpotLight
from relight3d.records import PatchMesh, ShadingPoints
from relight3d.shading import cast_light, points_along
from relight3d.tracing import RayScene

Lights = tuple[tuple[Light, ...], ...]
MIN_PHOTOS = 4  # in which a point must be valid
MIN_CHANGE = 0.05  # of a point's root of radiance from photograph to photograph, below which it tells nothing
NUM_SCREENED = 4  # readings that score best without shadows are scored with them
FACTORS = (1000.0, 100.0, 10.0, 0.1, 0.01, 0.001)
FOCAL_FACTORS = (2.0, 1.5, 1.25, 0.8, 0.67, 0.5)
TURNS_DEG = range(-165, 180, 15)  # about each axis; quarter turns have shorter names


@dataclass(frozen=True, eq=False)
class Sample:
    """Some points and the photographs of them: radiance by power in the one channel that all lamps have."""

    rays: RayScene
    mesh: PatchMesh
    camera: Camera
    points: ShadingPoints
    lights: Lights  # centred
    radiance: Float64[np.ndarray, "photo point"]
    is_valid: Bool[np.ndarray, "photo point"]
    channel: int

    def forms(self, lights: Lights, points: ShadingPoints, shadows: bool = True) -> Float64[np.ndarray, "photo point"]:
        """What each photograph's lights bring to the points, for a power of 1."""
        total = np.zeros((len(lights), len(points)))
        for photo, each in enumerate(lights):
            power = sum(light.power[self.channel] for light in each)
            for light in each:
                form = cast_light(self.rays, points, light, shadows=shadows).form
                total[photo] += form * (light.power[self.channel] / power)
        return total

    def agreement(
        self, form: Float[np.ndarray, "photo point"], index: np.ndarray | None = None
    ) -> Float64[np.ndarray, " told"] | None:
        """Each point's correlation with its form (of those of `index`); None where too few points tell anything."""
        radiance, is_valid = self.radiance, self.is_valid
        if index is not None:
            radiance, is_valid = radiance[:, index], is_valid[:, index]
        seen = np.sqrt(np.maximum(radiance, 0.0))
        told = (is_valid.sum(axis=0) >= MIN_PHOTOS) & (_spread(seen, is_valid) > MIN_CHANGE)
        if told.sum() < max(30, 0.5 * len(told)):
            return None
        return correlation(seen, np.sqrt(form), is_valid)[told]

    def score(self, form: Float[np.ndarray, "photo point"], index: np.ndarray | None = None) -> float | None:
        """The middle one of the points' agreements."""
        found = self.agreement(form, index)
        return None if found is None else float(np.median(found))


class Reading(NamedTuple):
    """Another way to read a capture: what it would be, and what to do if it is so."""

    field: str
    words: str  # follows "as with"
    hint: str
    lights: Lights
    camera: Camera
    is_turned: tuple[bool, bool] = (False, False)  # the picture, left to right and upside down


def correlation(
    a: Float[np.ndarray, "photo point"], b: Float[np.ndarray, "photo point"], use: Bool[np.ndarray, "photo point"]
) -> Float64[np.ndarray, " point"]:
    """Pearson's, over the photographs in use at each point; 0 where one of the two does not change."""
    count = np.maximum(use.sum(axis=0), 1)
    a = np.where(use, a - np.where(use, a, 0.0).sum(axis=0) / count, 0.0)
    b = np.where(use, b - np.where(use, b, 0.0).sum(axis=0) / count, 0.0)
    size = np.sqrt((a * a).sum(axis=0) * (b * b).sum(axis=0))
    return np.where(size > 1e-12, (a * b).sum(axis=0) / np.maximum(size, 1e-12), 0.0)


def best_reading(sample: Sample) -> tuple[Reading, float] | None:
    """The reading other than the given one that explains the photographs best, and its score."""
    screened = []
    for reading in readings(sample):
        score = _scored(sample, reading, shadows=False)
        if score is not None:
            screened.append((score, reading))
    screened.sort(key=lambda one: -one[0])
    scored = [(_scored(sample, reading, shadows=True), reading) for _, reading in screened[:NUM_SCREENED]]
    known = [(score, reading) for score, reading in scored if score is not None]
    if not known:
        return None
    score, reading = max(known, key=lambda one: one[0])
    return reading, score


def readings(sample: Sample) -> Iterator[Reading]:
    """Slips that are often made: axes, order, units, focal length, a turned picture."""
    lights, camera = sample.lights, sample.camera
    for words, hint, turn, shift in _frames(camera):
        moved = tuple(tuple(_turned(x, turn, shift, sample.mesh.center) for x in each) for each in lights)
        yield Reading("lights", words, hint, moved, camera)
    if len(lights) > MIN_PHOTOS:
        for step in (1, -1):
            words = f"each photograph under the lights of the one {'after' if step > 0 else 'before'} it"
            yield Reading("lights", words, "shift them by one", lights[step:] + lights[:step], camera)
        yield Reading("lights", "the lights in reversed order", "reverse them", lights[::-1], camera)
    for factor in FACTORS:
        hint = f"give mesh, camera and lights in one unit: multiply the mesh's vertices by {1 / factor:g}"
        words = f"a mesh {1 / factor:g} times as large"
        yield Reading("mesh_path", words, hint, *_other_unit(sample, factor))
        if not all(isinstance(light, DirectionalLight) for each in lights for light in each):
            hint = f"give lights in the mesh's unit: multiply position by {1 / factor:g}"
            moved, _ = _other_unit(sample, factor)
            yield Reading("lights", f"position {1 / factor:g} times as far", hint, moved, camera)
    for factor in FOCAL_FACTORS:
        other = replace(camera, fx=camera.fx * factor, fy=camera.fy * factor)
        words = f"a focal length about {factor:g} times as long"
        yield Reading("fl_x, fl_y", words, "give it in pixels of these photographs", lights, other)
    for is_turned, words in (((True, True), "turned by 180°"), ((True, False), "mirrored"), ((False, True), "flipped")):
        hint = "turn the files' pixels (an orientation tag is not read)"
        yield Reading("photographs", f"pictures {words}", hint, lights, camera, is_turned)


def _frames(camera: Camera) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Frames in which lights may be given: what to call them, what to do, and world_from_frame."""
    known = {
        "(-x, -y, -z)": "to_light points from the surface to the lamp: negate it",
        "(x, -z, y)": "the lights look y up where mesh and camera are z up",
        "(x, z, -y)": "the lights look z up where mesh and camera are y up",
    }
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.array(signs)[:, None] * np.eye(3)[list(order)]
        words = f"({', '.join(('-' if sign < 0 else '') + 'xyz'[axis] for axis, sign in zip(order, signs))})"
        if words != "(x, y, z)":
            hint = known.get(words, "give the lights in the axes of mesh and camera")
            yield f"{words} for each (x, y, z)", hint, turn, np.zeros(3)
    for axis, angle in product("xyz", TURNS_DEG):
        if angle % 90 != 0:
            words = f"lights turned by about {angle}° about {axis}"
            yield words, "give them in the axes of mesh and camera", _turn_about(axis, float(angle)), np.zeros(3)
    pose = camera.world_from_camera
    for words, signs in (("x right, y up, z back", (1, 1, 1)), ("x right, y down, z forward", (1, -1, -1))):
        hint = "turn them into the world by transform_matrix"
        yield f"lights in the camera's axes ({words})", hint, pose[:3, :3] * np.array(signs, np.float64), pose[:3, 3]


def _turned(light: Light, turn: np.ndarray, shift: np.ndarray, center: np.ndarray) -> Light:
    """A centred light whose file meant it in another frame."""
    if isinstance(light, DirectionalLight):
        return replace(light, to_light=tuple(turn @ np.asarray(light.to_light)))
    place = turn @ (np.asarray(light.position) + center) + shift - center
    if isinstance(light, SpotLight):
        return light.moved(position=tuple(place), direction=tuple(turn @ np.asarray(light.direction)))
    if isinstance(light, RectangleLight):
        edges = {name: tuple(turn @ np.asarray(getattr(light, name))) for name in ("edge_u", "edge_v")}
        return replace(light, position=tuple(place), **edges)
    return replace(light, position=tuple(place))


def _turn_about(axis: str, angle_deg: float) -> Float64[np.ndarray, "3 3"]:
    """A turn to the left about a coordinate axis."""
    x, y = (np.eye(3)[("xyz".index(axis) + k) % 3] for k in (1, 2))
    cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    along = np.eye(3)["xyz".index(axis)]
    flat = cosine * (np.outer(x, x) + np.outer(y, y)) + sine * (np.outer(y, x) - np.outer(x, y))
    return flat + np.outer(along, along)


def _other_unit(sample: Sample, factor: float) -> tuple[Lights, Camera]:
    """Lights and camera in a unit `factor` times smaller: the same as a mesh so many times smaller."""
    camera, center = sample.camera, sample.mesh.center
    moved = camera.translated((factor - 1.0) * camera.center)

    def far(light: Light) -> Light:
        if isinstance(light, DirectionalLight):
            return light
        return light.translated((factor - 1.0) * (np.asarray(light.position) + center))

    return tuple(tuple(far(light) for light in each) for each in sample.lights), moved


def _scored(sample: Sample, reading: Reading, shadows: bool) -> float | None:
    """None where the reading's camera misses the mesh at most of the points."""
    if reading.camera is sample.camera and not any(reading.is_turned):
        return sample.score(sample.forms(reading.lights, sample.points, shadows))
    points, index = _points_of(sample, reading)
    if len(points) < 0.4 * len(sample.points):
        return None
    return sample.score(sample.forms(reading.lights, points, shadows), index)


def _points_of(sample: Sample, reading: Reading) -> tuple[ShadingPoints, Int64[np.ndarray, " point"]]:
    """What the sample's pixels would show, and which of them show anything."""
    row, column = np.divmod(sample.points.pixel, sample.camera.width)
    place = np.stack([column, row], axis=1) + 0.5
    for axis, size in enumerate((sample.camera.width, sample.camera.height)):
        if reading.is_turned[axis]:
            place[:, axis] = size - place[:, axis]
    # The number of the sample stands in for the pixel, so that each hit is known again.
    index = np.arange(len(place), dtype=np.int64)
    points = points_along(sample.rays, sample.mesh, reading.camera, index, place)
    return points, points.pixel.astype(np.int64)


def _spread(values: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Standard deviation by mean over the photographs in use."""
    count = np.maximum(use.sum(axis=0), 1)
    mean = np.where(use, values, 0.0).sum(axis=0) / count
    square = np.where(use, (values - mean) ** 2, 0.0).sum(axis=0) / count
    return np.sqrt(square) / np.maximum(mean, 1e-30)
