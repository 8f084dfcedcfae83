"""Times side by side: every contender once in each round, so that a busy machine is busy for all of them alike."""

import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from relight3d.camera import Camera
from relight3d.evaluate.baselines import BASELINES, fit_baseline
from relight3d.lights import DirectionalLight
from relight3d.records import RelightModel
from relight3d.relight.options import PRESETS, RelightOptions
from relight3d.relight.relighter import Relighter
from relight3d.tracing import RayScene, num_threads

TURNS = 4  # of each contender in a round

Contender = Callable[[int], object]


class Took(NamedTuple):
    """Milliseconds of each round: by the clock, and of all cores together."""

    wall: list[float]
    cores: list[float]


def side_by_side(contenders: Mapping[str, Contender], rounds: int) -> dict[str, Took]:
    """Each contender's times; one round before, to warm up, is not counted.

    In a round each has several turns and the last counts, with its own data in the cache as in a sequence of frames.
    On a machine that others use, the clock counts their work too, and more so where threads wait for each other. The
    cores' time does not, but says nothing of how well threads share the work.
    """
    took = {name: Took([], []) for name in contenders}
    for index in range(-1, rounds):
        for name, contender in contenders.items():
            for turn in range(TURNS - 1):
                contender(TURNS * (index + 1) + turn)
            start, start_cores = time.perf_counter(), time.process_time()
            contender(TURNS * (index + 2) - 1)
            if index >= 0:
                took[name].wall.append(1e3 * (time.perf_counter() - start))
                took[name].cores.append(1e3 * (time.process_time() - start_cores))
    return took


def moving_light(index: int, color: tuple[float, float, float] = (3.0, 3.0, 3.0)) -> DirectionalLight:
    """A light on a circle 50 degrees up: no frame can reuse another's shadows."""
    angle = 0.37 * (index + 1)
    return DirectionalLight((np.cos(angle), np.sin(angle), 1.2), color)


def three_lights(index: int) -> list[DirectionalLight]:
    """Red, green and blue, each moving."""
    colors = ((3.0, 0.5, 0.5), (0.5, 3.0, 0.5), (0.5, 0.5, 3.0))
    return [moving_light(index + 100 * k, color) for k, color in enumerate(colors)]


def bare_embreex(scene: RayScene, relighter: Relighter) -> dict[str, Contender]:
    """embreex alone, ray by ray on the same threads: one shadow ray for every pixel that hits, and first hits."""
    points = _one_a_pixel(relighter)
    origins = scene.offset(points.position, points.geometric_normal)
    camera = relighter.camera
    directions = camera.pixel_directions().astype(np.float32)
    eye = np.broadcast_to((camera.center - relighter.model.mesh.center).astype(np.float32), directions.shape)
    eye = np.ascontiguousarray(eye)

    def occlusion(index: int) -> object:
        return scene.is_blocked(origins, np.array([moving_light(index).to_light], np.float32))

    return {"bare occlusion": occlusion, "bare first hit": lambda index: scene.first_hit(eye, directions)}


def open3d_rays(relighter: Relighter) -> dict[str, Contender]:
    """Open3D's RaycastingScene, the same shadow rays on the same threads."""
    import open3d

    mesh, points = relighter.model.mesh, _one_a_pixel(relighter)
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh.centered_vertices, mesh.faces.astype(np.uint32))
    origins = points.position + points.geometric_normal * 1e-5 * np.float32(mesh.radius)

    def occlusion(index: int) -> object:
        ways = np.broadcast_to(np.asarray(moving_light(index).to_light, np.float32), origins.shape)
        rays = open3d.core.Tensor(np.concatenate([origins, ways], axis=1))
        return scene.test_occlusions(rays, nthreads=num_threads()).numpy()

    return {"Open3D occlusion": occlusion}


def frames(model: RelightModel, camera: Camera) -> tuple[Relighter, dict[str, Contender]]:
    """Our frames: the presets, three lights, a new colour, a new viewpoint."""
    exact = Relighter(model, camera)
    contenders: dict[str, Contender] = {"frame, exact": lambda k: exact.render([moving_light(k)])}
    for name in ("balanced", "fast", "baked"):
        other = Relighter(model, camera, PRESETS[name])
        contenders[f"frame, {name}"] = lambda k, other=other: other.render([moving_light(k)])
    contenders["frame, three lights"] = lambda k: exact.render(three_lights(k))
    fixed = Relighter(model, camera)
    contenders["frame, new colour"] = lambda k: fixed.render([moving_light(0, (1.0 + k, 2.0, 3.0))])
    turning = {
        "new viewpoint": Relighter(model, camera),
        "new viewpoint, no outlines": Relighter(model, camera, RelightOptions(edge_samples=1)),
    }
    for name, relighter in turning.items():

        def look(k: int, relighter: Relighter = relighter) -> object:
            relighter.set_camera(camera.translated(np.array([0.002, 0.001, 0.0]) * (k + 2) * model.mesh.radius))
            return relighter.render([moving_light(k)])

        contenders[name] = look
    return exact, contenders


def interpolators(model: RelightModel) -> dict[str, Contender]:
    """PTM, HSH and RBF on as many pixels and photographs."""
    lights = [each for each in model.lights if each]
    rng = np.random.default_rng(0)
    photographs = rng.random((len(lights), len(model.pixels.points), 3), np.float32)
    fitted = {name: fit_baseline(name, lights, photographs, model.mesh.center) for name in BASELINES}
    return {name: lambda k, b=b: b.predict([moving_light(k)]) for name, b in fitted.items()}


def _one_a_pixel(relighter: Relighter):
    points = relighter.view.points
    _, first = np.unique(points.pixel, return_index=True)
    return points.take(first)
