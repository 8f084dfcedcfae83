"""Two small recovered models, shared by the tests of plans, prices and budgets."""

from dataclasses import replace
from functools import cache

import numpy as np

from relight3d.evaluate.scenes import Material, Scene, hemisphere_lights, scene_camera
from relight3d.evaluate.shapes import box, joined, sphere, transformed
from relight3d.evaluate.synthetic import synthesize
from relight3d.records import Capture, RelightModel
from relight3d.recover.mesh import MeshOptions
from relight3d.recover.run import RecoverOptions, recover
from tests.scenes import HEIGHT, WIDTH, desk_capture

QUICK = RecoverOptions(mesh=MeshOptions(target_faces=2000), num_rounds=1, num_alternations=2)


@cache
def rich_capture() -> Capture:
    """A desk with everything: gloss, texture, a mirror, ambient light."""
    return desk_capture(12, glossy=True, textured=True, mirror=True, ambient=0.3, lights_off=True)


@cache
def rich_model() -> RelightModel:
    return recover(rich_capture(), QUICK, quiet=True)


@cache
def plain_capture(size: int = 1) -> Capture:
    """Two diffuse convex objects on nothing, no light but the lamps'; pixels are means of 4 x 4, as a sensor's are.

    `size` times as many pixels a side.
    """
    parts = {
        "box": transformed(box(0.6, 0.5, 0.7), None, (-0.5, 0.1, 0.3)),
        "sphere": transformed(sphere(0.4), None, (0.5, -0.1, 0.3)),
    }
    materials = (Material((0.6, 0.2, 0.15)), Material((0.2, 0.35, 0.5)))
    camera = scene_camera(size * WIDTH, size * HEIGHT)
    fine = Scene(joined(parts), materials, scene_camera(4 * camera.width, 4 * camera.height))
    capture = synthesize(fine, hemisphere_lights(12, seed=1), test_lights=hemisphere_lights(4, 30.0, 75.0, seed=2))
    photographs = tuple(replace(p, camera=camera, pixels=means(p.pixels)) for p in capture.photographs)
    return replace(capture, camera=camera, photographs=photographs)


def means(picture: np.ndarray) -> np.ndarray:
    """Means of 4 x 4 pixels; what misses the mesh is black, and a part of them."""
    height, width = picture.shape[0] // 4, picture.shape[1] // 4
    return picture.reshape(height, 4, width, 4, -1).mean(axis=(1, 3))


@cache
def plain_model(size: int = 1, force: tuple[str, ...] = ()) -> RelightModel:
    return recover(plain_capture(size), replace(QUICK, force=force), quiet=True)
