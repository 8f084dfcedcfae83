"""Scenes whose truth is known: meshes, materials, a camera, and rigs of lights."""

from dataclasses import dataclass

import numpy as np

from relight3d.camera import Camera, look_at
from relight3d.evaluate.shapes import box, joined, plane, sphere, transformed, turn_about
from relight3d.lights import DirectionalLight, Light, PointLight
from relight3d.maths.light_basis import GOLDEN_ANGLE
from relight3d.records import Lobe, TriangleMesh

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """What a surface of a synthetic scene is made of."""

    albedo: Color
    checker_albedo: Color | None = None  # of every other square, if it has a pattern
    num_checkers: int = 8  # squares along a side of the UV square
    lobes: tuple[Lobe, ...] = ()
    mirror: float = 0.0  # reflectance of a mirror; it shows nothing of its albedo
    relief_slope: float = 0.0  # slope of waves over the surface, seen in its normals only
    num_waves: float = 6.0  # waves along a side of the UV square

    @property
    def kinds(self) -> tuple[str, ...]:
        """The words of records.KINDS for it."""
        if self.mirror > 0:
            return ("mirror",)
        base = "diffuse" if self.checker_albedo is None else "textured"
        return (base, "glossy") if self.lobes else (base,)


@dataclass(frozen=True, eq=False)
class Scene:
    """A mesh, its materials by `object_id`, the camera, and constant light from all sides (irradiance)."""

    mesh: TriangleMesh
    materials: tuple[Material, ...]
    camera: Camera
    ambient: Color = (0.0, 0.0, 0.0)


def plastic(color: float, exponent: float) -> Lobe:
    """An isotropic highlight about the mirror direction."""
    axes = np.array([-1.0, -1.0, 1.0])
    return Lobe(np.full(3, color), axes, exponent, np.zeros(3))


def scene_camera(width: int, height: int, eye: Color = (0.0, -3.0, 2.4), target: Color = (0.0, 0.0, 0.2)) -> Camera:
    """A camera at `eye` that looks at `target`, 40 degrees wide."""
    focal = float(0.5 * width / np.tan(np.deg2rad(20.0)))
    pose = look_at(np.array(eye), np.array(target))
    return Camera(width, height, focal, focal, width / 2, height / 2, world_from_camera=pose)


def desk_scene(
    width: int = 64,
    height: int = 48,
    glossy: bool = False,
    textured: bool = False,
    mirror: bool = False,
    ambient: float = 0.0,
) -> Scene:
    """A table with a box and a sphere; on demand a glossy sphere, a checkered table, a mirror board behind."""
    parts = {
        "table": plane(2.4, 2.0, 6, 5),
        "box": transformed(box(0.5, 0.4, 0.6), turn_about("z", 25.0), (-0.5, 0.1, 0.3)),
        "sphere": transformed(sphere(0.3), None, (0.45, -0.15, 0.3)),
    }
    materials = [
        Material((0.55, 0.5, 0.45), checker_albedo=(0.2, 0.22, 0.3) if textured else None),
        Material((0.6, 0.2, 0.15)),
        Material((0.2, 0.35, 0.5), lobes=(plastic(0.25, 30.0),) if glossy else ()),
    ]
    if mirror:
        # It stands behind the others, leaning back a little, and faces the camera.
        board = transformed(plane(0.9, 0.7, 2, 2), turn_about("x", 80.0), (0.35, 0.75, 0.36))
        parts["mirror"] = board
        materials.append(Material((0.02, 0.02, 0.02), mirror=0.8))
    return Scene(joined(parts), tuple(materials), scene_camera(width, height), (ambient, ambient, ambient))


def hemisphere_lights(
    num: int,
    min_elevation_deg: float = 25.0,
    max_elevation_deg: float = 80.0,
    irradiance: float | Color = np.pi,
    distance: float | None = None,
    center: Color = (0.0, 0.0, 0.0),
    seed: int = 0,
) -> list[tuple[Light, ...]]:
    """One light a photograph, spread evenly over a zone of the upper hemisphere by a golden spiral that the seed turns.

    With a `distance` they are point lights about `center`, of the same irradiance there.
    """
    rng = np.random.default_rng(seed)
    low, high = np.sin(np.deg2rad([min_elevation_deg, max_elevation_deg]))
    # The order is shuffled, so that the first few lights of a rig are spread as well.
    index = rng.permutation(num)
    z = high - (high - low) * (index + rng.uniform(0.25, 0.75)) / num
    azimuth = GOLDEN_ANGLE * index + rng.uniform(0.0, 2 * np.pi)
    ring = np.sqrt(1.0 - z * z)
    directions = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
    color = np.broadcast_to(np.asarray(irradiance, np.float64), 3)
    if distance is None:
        return [(DirectionalLight(tuple(d), tuple(color)),) for d in directions]
    return [(PointLight(tuple(center + distance * d), tuple(color * distance**2)),) for d in directions]
