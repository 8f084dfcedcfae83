"""Captures whose truth is known: photographs of a scene, made with the forward model.

Such a capture proves the solvers, and prices noise and outliers (see `disturb`). It cannot judge the model, since it is
made with it; only the interreflections come from elsewhere: one bounce, traced.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from relight3d.camera import Camera
from relight3d.evaluate.scenes import GOLDEN_ANGLE, Scene
from relight3d.evaluate.world import World
from relight3d.lights import Light
from relight3d.maths.lafortune import tangent_frame
from relight3d.records import Capture, Photograph, ShadingPoints
from relight3d.shading import points_mirrored, points_seen


def synthesize(
    scene: Scene,
    lights: Sequence[Sequence[Light]],
    test_lights: Sequence[Sequence[Light]] = (),
    viewpoints: Sequence[Camera] = (),
    num_bounce_rays: int = 0,
) -> Capture:
    """A capture in memory: training photographs under `lights`, held-out ones under `test_lights` (group "light").

    Each of `viewpoints` adds a held-out photograph (group "viewpoint") under one of the test lights, in turn.
    `num_bounce_rays` a pixel bring the light of one bounce between surfaces; 0 leaves interreflections out.
    """
    picture = _Picture(scene, scene.camera, num_bounce_rays)
    photographs = [
        Photograph(f"{split}_{i:03d}", split, tuple(each), scene.camera, group=group, pixels=picture.render(each))
        for split, group, sets in (("train", "", lights), ("test", "light", test_lights))
        for i, each in enumerate(sets)
    ]
    held_out = list(test_lights) or list(lights)
    for i, camera in enumerate(viewpoints):
        each = tuple(held_out[i % len(held_out)])
        pixels = _Picture(scene, camera, num_bounce_rays).render(each)
        photographs.append(Photograph(f"view_{i:03d}", "test", each, camera, group="viewpoint", pixels=pixels))
    return Capture(Path(), scene.camera, tuple(photographs), scene.mesh)


class _Picture:
    """One view of a scene: what each pixel shows, kept from light to light."""

    def __init__(self, scene: Scene, camera: Camera, num_bounce_rays: int) -> None:
        self.world, self.camera = World(scene), camera
        seen = points_seen(self.world.rays, self.world.mesh, camera)
        reflectance = np.array([m.mirror for m in scene.materials])[self.world.object_of_face[seen.face]]
        behind_glass = seen.take(reflectance > 0)
        shown = points_mirrored(self.world.rays, self.world.mesh, behind_glass)
        gain_of_pixel = np.ones(camera.num_pixels, np.float32)
        gain_of_pixel[behind_glass.pixel] = reflectance[reflectance > 0]
        # A mirror's pixel shows the reflected point in place of its own.
        self.points = _concatenated(seen.take(reflectance == 0), shown)
        self.gain = gain_of_pixel[self.points.pixel]
        self.surroundings = _rays_around(self.points, num_bounce_rays)
        self.bounce = points_mirrored(self.world.rays, self.world.mesh, self.surroundings)
        self.num_bounce_rays = num_bounce_rays

    def render(self, lights: Sequence[Light]) -> Float32[np.ndarray, "height width 3"]:
        """Linear radiance under lights in world coordinates."""
        world, points = self.world, self.points
        centered = [light.translated(-world.mesh.center) for light in lights]
        direct, specular = world.lit(points, centered)
        irradiance = direct + np.asarray(world.scene.ambient, np.float32) + self._bounced(centered)
        radiance = (world.albedo(points) / np.float32(np.pi) * irradiance + specular) * self.gain[:, None]
        image = np.zeros((self.camera.num_pixels, 3), np.float32)
        image[points.pixel] = radiance
        return image.reshape(self.camera.height, self.camera.width, 3)

    def _bounced(self, lights: Sequence[Light]) -> Float32[np.ndarray, "point 3"]:
        """Irradiance from surfaces around each point that the lights reach; the directions are spread by the cosine."""
        total = np.zeros((len(self.points), 3))
        if len(self.bounce):
            direct, _ = self.world.lit(self.bounce, lights)
            # `pixel` holds the point that the ray left from. The radiances' mean times pi is their irradiance.
            np.add.at(total, self.bounce.pixel, direct * self.world.albedo(self.bounce))
        return (total / max(self.num_bounce_rays, 1)).astype(np.float32)


def _rays_around(points: ShadingPoints, num: int) -> ShadingPoints:
    """`num` cosine-spread rays for each point, in the form that `points_mirrored` casts.

    A mirror that faces along d reflects a viewer at d back along d: so d is written as normal and as viewer. `pixel`
    counts the points.
    """
    radius, azimuth = np.sqrt((np.arange(num) + 0.5) / max(num, 1)), GOLDEN_ANGLE * np.arange(num)
    local = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.sqrt(1.0 - radius**2)], axis=1)
    frame = np.stack([*tangent_frame(points.normal), points.normal], axis=1)
    directions = np.einsum("rk,pki->pri", local, frame).reshape(-1, 3).astype(np.float32)
    index = np.arange(len(points), dtype=np.int32).repeat(num)
    return replace(points.take(index), pixel=index, normal=directions, to_viewer=directions)


def _concatenated(*parts: ShadingPoints) -> ShadingPoints:
    names = [f.name for f in fields(ShadingPoints)]
    return ShadingPoints(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
