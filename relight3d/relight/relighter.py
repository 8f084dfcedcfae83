"""The relighter: everything that does not depend on the light is made once, then each frame is lights only."""

import time

import numpy as np

from relight3d.camera import Camera
from relight3d.forward import gather_pixels, shade_points
from relight3d.lights import Light
from relight3d.records import Frame, RelightModel, Stats, Terms
from relight3d.shading import ray_scene
from relight3d.views import build_view


class Relighter:
    """Relights a model from one viewpoint: the captured one, or `camera`."""

    def __init__(self, model: RelightModel, camera: Camera | None = None) -> None:
        self.model = model
        self.camera = camera or model.camera
        self._scene = ray_scene(model.mesh)
        self.view = build_view(self._scene, model, self.camera)

    def render(self, lights: list[Light] | tuple[Light, ...]) -> Frame:
        """Linear radiance under the lights (world coordinates)."""
        start = time.perf_counter()
        view, model = self.view, self.model
        centred = [light.translated(-model.mesh.center) for light in lights]
        shaded = shade_points(self._scene, model, view, centred)
        picture = gather_pixels(model, view, centred, shaded)
        total = np.maximum(sum(picture), 0.0)
        stats = Stats(
            {"shade": 1e3 * (time.perf_counter() - start)},
            {"shadow": shaded.num_rays, "thrown": shaded.num_thrown_rays, "border": shaded.num_border_rays},
        )
        return Frame(
            total.reshape(self.camera.height, self.camera.width, 3),
            view.is_hit,
            model.exposure,
            stats,
            Terms(None, None, None, None),
        )
