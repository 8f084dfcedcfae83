"""Shadow borders of whole views against finely sampled shadows, and the compiled loops against the reference."""

import numpy as np
import pytest

from relight3d.forward import border_fractions
from relight3d.lights import FAR, Light
from relight3d.maths.pixel_parts import BESIDE_LINE, HALVINGS, PLACES, own_part
from relight3d.relight import ray_kernels
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter
from relight3d.shading import cast_light
from tests.borders import FOUR_RAYS
from tests.relight import models

STEPS = (np.arange(10) + 0.5) / 10 - 0.5
FINE = np.array([(dx, dy) for dx in STEPS for dy in STEPS], np.float32)


class Bordered:
    """A view of the full desk under a light: its border points and their lit shares."""

    def __init__(self, light: Light) -> None:
        model = models.full()
        camera = model.camera.resized(256, 192)
        relighter = Relighter(model, camera, RelightOptions(backend="numpy"))
        self.scene, self.view, self.light = relighter._scene, relighter.view, light.translated(-model.mesh.center)
        surface = model.surfaces.surface_of_face
        self.lit = cast_light(self.scene, self.view.points, self.light, self.view.normal, (), surface)
        self.index, self.share, self.rays = border_fractions(self.scene, self.view, self.light, self.lit)

    def sampled(self, pattern: np.ndarray) -> np.ndarray:
        """The share of rays from so many places of each border pixel that come through."""
        points, step, total = self.view.points, self.view.step[self.index], np.zeros(len(self.index))
        for dx, dy in pattern:
            moved = points.position[self.index] + dx * step[:, 0] + dy * step[:, 1]
            to_light, _, distance = self.light.incident(moved)
            limit = None if distance[0] >= FAR else distance - 2 * self.scene.offset_distance
            origins = self.scene.offset(moved, points.geometric_normal[self.index])
            total += ~self.scene.is_blocked(origins, to_light[:1] if limit is None else to_light, limit)
        return total / len(pattern)


@pytest.mark.parametrize(
    "light, share", [(models.SUN, 0.5), (models.RED, 0.8), (models.LAMP, 0.5)], ids=["sun", "low sun", "lamp"]
)
def test_borders_are_finer_than_four_rays_and_take_fewer(light: Light, share: float) -> None:
    """Under the low sun many borders lie on curved surfaces, where each facet shadows itself in its own way."""
    found = Bordered(light)
    truth = found.sampled(FINE)
    error, by_four = (np.abs(each - truth) for each in (found.share, found.sampled(FOUR_RAYS)))
    mirrored = found.view.is_mirrored[found.index]
    assert len(truth) > 300
    assert error.mean() < share * by_four.mean()
    assert found.rays < len(FOUR_RAYS) * len(truth)
    if mirrored.sum() > 50:
        assert error[mirrored].mean() < 0.8 * by_four[mirrored].mean()


def test_borders_lie_between_points_that_face_the_light() -> None:
    """Where a surface turns away (an attached shadow) its cosine fades the light out: there is no border."""
    found = Bordered(models.SUN)
    view, lit = found.view, found.lit
    faces = (lit.cosine > 0) & (np.einsum("pi,pi->p", view.points.geometric_normal, lit.to_light) > 0)
    assert faces[found.index].all()
    there = np.maximum(view.neighbour[found.index], 0)
    differs = (view.neighbour[found.index] >= 0) & faces[there] & (lit.is_lit[there] != lit.is_lit[found.index, None])
    assert differs.any(axis=1).all()
    terminator = ~faces & (lit.is_lit[np.maximum(view.neighbour, 0)] & (view.neighbour >= 0)).any(axis=1)
    assert terminator.sum() > 20


def test_compiled_areas_are_those_of_the_reference() -> None:
    edges = np.stack(np.meshgrid(*[np.arange(PLACES + 1, dtype=np.uint8)[::2]] * 4), axis=-1).reshape(-1, 4)
    edges = np.concatenate([edges, np.random.default_rng(0).integers(0, PLACES + 1, (2000, 4)).astype(np.uint8)])
    got = [ray_kernels._own_part(row, BESIDE_LINE) for row in edges]
    np.testing.assert_array_equal(got, own_part(edges))


def test_compiled_borders_leave_nothing_behind() -> None:
    """A second light finds the edges' array as the first one did."""
    relighter = Relighter(models.full())
    first = relighter.render([models.SUN])
    assert not relighter._engine.shadows._borders._edges.any()
    assert first.stats.rays["border"] > 0 and first.stats.rays["border"] % HALVINGS == 0
    relighter.render([models.LAMP])
    again = Relighter(models.full()).render([models.LAMP])
    np.testing.assert_array_equal(relighter.render([models.LAMP]).radiance, again.radiance)
