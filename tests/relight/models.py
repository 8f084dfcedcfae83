"""Small models for the engine's tests: the true model of a synthetic desk, with all that a recovery could add."""

from dataclasses import replace
from functools import cache

import numpy as np

from relight3d.camera import Camera, look_at
from relight3d.evaluate.scenes import hemisphere_lights
from relight3d.evaluate.truth import true_model
from relight3d.lights import DirectionalLight, Light, PointLight, SpotLight
from relight3d.maths.light_basis import BASES
from relight3d.records import Indirect, Lobe, RelightModel, Residual
from tests import scenes

SUN = DirectionalLight((0.3, -0.4, 0.8), (2.0, 3.0, 1.0))
RED = DirectionalLight((-0.6, 0.1, 0.5), (3.0, 0.2, 0.1))
LAMP = PointLight((0.5, -0.3, 1.4), (1.0, 1.0, 2.0))
SPOT = SpotLight((-0.5, 0.3, 1.8), (0.3, -0.2, -1.0), (3.0, 2.0, 1.0), 0.2, 0.5)
LIGHTS: dict[str, list[Light]] = {
    "directional": [SUN],
    "point": [LAMP],
    "spot": [SPOT],
    "several": [SUN, RED, LAMP, SPOT],
    "none": [],
}


@cache
def plain() -> RelightModel:
    """Direct light and shadows only."""
    return true_model(scenes.desk())


@cache
def full(basis: str = "sh2", site: str = "vertex") -> RelightModel:
    """A desk with gloss (lobes anisotropic, brushed, and about the half-way direction), mirror that throws light, indirect
    light, detail, residual.
    """
    model = true_model(scenes.desk(glossy=True, textured=True, mirror=True), hemisphere_lights(7))
    rng = np.random.default_rng(0)
    num = len(model.pixels.points)
    tilted = model.pixels.points.normal + 0.05 * rng.normal(size=(num, 3))
    tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
    gain = rng.uniform(0.5, 1.5, num).astype(np.float32)
    brushed = Lobe(np.full(3, 0.3), np.array([-1.0, -0.8, 0.9]), 12.0, np.array([1.0, 0.2, 0.0]))
    varnish = Lobe(np.array([0.5, 0.4, 0.3]), np.array([60.0, 60.0, 1.0]), 2.0, is_halfway=True)
    grooved = Lobe(
        np.full(3, 0.5), np.array([90.0, 7.0, 1.0]), 2.4, np.array([0.1, 0.3, -0.2]), np.array([0.5, -0.2, 1.0]), True
    )
    return replace(
        model,
        pixels=replace(model.pixels, normal=tilted.astype(np.float32), lobe_gain=gain),
        indirect=random_indirect(model, basis, site, rng),
        residual=random_residual(num, rng),
        lobes=((brushed, varnish), (grooved,), *model.lobes[2:]),
    )


def random_indirect(model: RelightModel, basis: str, site: str, rng: np.random.Generator) -> Indirect:
    """Indirect light of no particular scene, dark enough in places to be clamped at 0."""
    sites = {"vertex": len(model.mesh.vertices), "face": len(model.mesh.faces), "pixel": len(model.pixels.points)}
    coefficients = 0.3 * rng.normal(size=(sites[site], BASES[basis], 3)).astype(np.float32)
    ambient = rng.uniform(0.0, 0.5, (sites[site], 3)).astype(np.float32)
    anchors = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    return Indirect(basis, site, coefficients, ambient, anchors, 0.4, 0.3, True)


STEP = 1e-4  # of a residual's modes


def random_residual(num_points: int, rng: np.random.Generator, num_modes: int = 5) -> Residual:
    """Modes of falling strength."""
    fall = 0.05 / (1 + np.arange(num_modes, dtype=np.float32))[:, None]
    lit, dark = (np.rint(fall / STEP * rng.normal(size=(num_points, num_modes, 3))).astype(np.int16) for _ in range(2))
    anchors = rng.normal(size=(6, 3))
    anchors /= np.linalg.norm(anchors, axis=1, keepdims=True)
    weights = STEP * rng.normal(size=(2, num_modes, 6))
    return Residual(lit, weights[0], dark, weights[1], anchors, 0.6, 0.9)


def other_camera(model: RelightModel, turn_rad: float = 0.15) -> Camera:
    """The captured camera moved around the scene's middle."""
    center, (c, s) = model.mesh.center, (np.cos(turn_rad), np.sin(turn_rad))
    eye = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ (model.camera.center - center) + center
    return Camera.from_transform(look_at(eye, center), model.camera)
