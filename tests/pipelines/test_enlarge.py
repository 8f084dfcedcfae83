"""The benchmark's larger meshes: the same scene, cut finer."""

import numpy as np

from pipelines.bench.enlarge import with_faces
from relight3d.evaluate.scenes import scene_camera
from relight3d.relight.relighter import Relighter
from tests.plan.models import rich_model
from tests.scenes import HEIGHT, WIDTH


def test_a_finer_mesh_shows_the_same_from_another_viewpoint() -> None:
    model, camera = rich_model(), scene_camera(WIDTH, HEIGHT, eye=(0.6, -2.9, 2.3))
    finer = with_faces(model, len(model.mesh.faces) + 1)
    assert len(finer.mesh.faces) == 4 * len(model.mesh.faces)
    as_it_was, cut = (Relighter(one, camera).render(model.lights[1]).radiance for one in (model, finer))
    # Cut faces meet their neighbours' rays a little elsewhere: single pixels on edges may differ.
    off = np.abs(cut - as_it_was).max(axis=2)
    assert np.quantile(off, 0.98) < 1e-3 * as_it_was.max()
