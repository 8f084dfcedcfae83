"""Tiny captures with known truth, made once a test run and shared by the tests of every stage."""

from functools import cache

import numpy as np

from relight3d.evaluate.scenes import Material, Scene, desk_scene, hemisphere_lights, scene_camera
from relight3d.evaluate.shapes import box, joined, plane, transformed, turn_about
from relight3d.evaluate.synthetic import synthesize
from relight3d.evaluate.truth import Truth, truth_of
from relight3d.records import Capture, Lobe

WIDTH, HEIGHT = 64, 48


@cache
def desk(glossy: bool = False, textured: bool = False, mirror: bool = False, ambient: float = 0.0) -> Scene:
    """A table with a box and a sphere; on demand a glossy sphere, a checkered table, a mirror board."""
    return desk_scene(WIDTH, HEIGHT, glossy, textured, mirror, ambient)


@cache
def desk_truth(glossy: bool = False, textured: bool = False, mirror: bool = False) -> Truth:
    """What the camera of the same desk sees."""
    return truth_of(desk(glossy, textured, mirror))


@cache
def desk_capture(
    num_lights: int = 12,
    glossy: bool = False,
    textured: bool = False,
    mirror: bool = False,
    ambient: float = 0.0,
    bounce: bool = True,
    distance: float | None = None,
    lights_off: bool = False,
) -> Capture:
    """The desk under `num_lights` training lights and four held-out ones, and from one other viewpoint.

    `distance` makes them point lights; `lights_off` adds a training photograph of the ambient light alone.
    """
    train = hemisphere_lights(num_lights, distance=distance, seed=1)
    return synthesize(
        desk(glossy, textured, mirror, ambient),
        train + [()] * lights_off,
        test_lights=hemisphere_lights(4, 30.0, 75.0, distance=distance, seed=2),
        viewpoints=[scene_camera(WIDTH, HEIGHT, eye=(0.6, -2.9, 2.3))],
        num_bounce_rays=48 if bounce else 0,
    )


def metal_capture(albedo: float, num_lights: int = 12) -> Capture:
    """A matte table with a box and a lid of rough metal, in constant ambient light that no photograph shows alone."""
    rough = Lobe(np.array([0.9, 0.8, 0.7]), np.array([10.0, 10.0, 1.0]), 2.0, is_halfway=True)
    turn = turn_about("z", 25.0)
    parts = {
        "table": plane(2.4, 2.0, 6, 5),
        "box": transformed(box(0.5, 0.4, 0.6), turn, (-0.5, 0.1, 0.3)),
        "lid": transformed(box(0.4, 0.4, 0.05), turn, (0.5, 0.1, 0.3)),
    }
    metal = Material((albedo, albedo, albedo), lobes=(rough,))
    materials = (Material((0.5, 0.4, 0.3)), metal, metal)
    scene = Scene(joined(parts), materials, scene_camera(80, 60), (0.3, 0.3, 0.3))
    return synthesize(scene, hemisphere_lights(num_lights, seed=1))
