"""float32 frames against the same forward model written out in float64, pixel by pixel."""

import numpy as np
import pytest

from relight3d.evaluate.scenes import desk_scene
from relight3d.evaluate.truth import true_model
from relight3d.forward import gather_pixels, shade_points
from relight3d.lights import DirectionalLight, PointLight, SpotLight
from relight3d.records import RelightModel
from relight3d.shading import ray_scene
from relight3d.views import ViewOptions, build_view
from tests.properties.test_forward_model import glossy_model

# Positions, normals and cosines carry a few times 6e-8; a lobe multiplies the relative error of its base by its
# exponent, 30 here, and the square of a lamp's distance by 2. Measured: 5e-6 at most; ten times that is the bound.
LARGEST = 5e-5


def reference(model: RelightModel, lights) -> tuple[np.ndarray, np.ndarray]:
    """Radiance of the captured points as if nothing cast a shadow, in float64, and their pixels."""
    mesh, pixels = model.mesh, model.pixels
    points = pixels.points
    corners = (mesh.vertices - mesh.center)[mesh.faces[points.face]]
    bary = points.barycentric.astype(np.float64)
    position = np.einsum("pk,pki->pi", bary, corners)
    normal = np.einsum("pk,pki->pi", bary, mesh.vertex_normals[mesh.faces[points.face]].astype(np.float64))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    viewer = model.camera.center - mesh.center - position
    viewer /= np.linalg.norm(viewer, axis=1, keepdims=True)
    normal *= np.sign(np.einsum("pi,pi->p", normal, viewer))[:, None]
    total = np.zeros((len(points), 3))
    for light in lights:
        to_light, irradiance, _ = light.translated(-mesh.center).incident(position)
        cosine = np.maximum(np.einsum("pi,pi->p", normal, to_light), 0.0)[:, None]
        brdf = pixels.albedo.astype(np.float64) / np.pi
        for surface, lobes in enumerate(model.lobes):
            for lobe in lobes:
                mine = pixels.surface == surface
                u_n, v_n = (np.einsum("pi,pi->p", normal, way) for way in (to_light, viewer))
                across = np.einsum("pi,pi->p", to_light, viewer) - u_n * v_n
                base = lobe.axes[0] * across + lobe.axes[2] * u_n * v_n
                brdf = brdf + mine[:, None] * np.maximum(base, 0.0)[:, None] ** lobe.exponent * lobe.color
        total += brdf * irradiance * cosine
        # The linear functions of eq. (7) at the faces' middles, softened near a lamp.
        middle = (mesh.vertices - mesh.center)[mesh.faces].mean(axis=1)
        ways, _, distance = light.translated(-mesh.center).incident(middle)
        strength = np.ones(len(middle))
        if light.kind != "directional":
            part = 1.0 if light.kind == "point" else light.cone(ways).mean()
            strength = part / np.maximum(distance, model.indirect.softening) ** 2
        rows = np.concatenate([np.ones((len(middle), 1)), ways], axis=1) * strength[:, None]
        fitted = np.einsum("nbc,nb->nc", model.indirect.coefficients.astype(np.float64), rows) * light.power
        total += (pixels.albedo / np.pi * fitted[points.face]).astype(np.float64)
    return total, points.pixel


@pytest.mark.parametrize(
    "light",
    [
        DirectionalLight((0.3, -0.5, 0.9), (3.0, 2.0, 1.0)),
        PointLight((0.6, -1.0, 2.2), (9.0, 7.0, 5.0)),
        SpotLight((0.6, -1.0, 2.2), (-0.2, 0.4, -1.0), (9.0, 7.0, 5.0), 0.3, 0.7),
    ],
    ids=lambda light: light.kind,
)
def test_frames_agree_with_float64(light):
    model = glossy_model(desk_scene(40, 30, glossy=True))
    scene = ray_scene(model.mesh)
    view = build_view(scene, model, model.camera, ViewOptions(edge_samples=1))
    centred = [light.translated(-model.mesh.center)]
    shaded = shade_points(scene, model, view, centred, borders=False)
    got = gather_pixels(model, view, centred, shaded)
    wanted, pixel = reference(model, [light])
    got = sum(got)[pixel].astype(np.float64)
    # Which points are in shadow is not a question of digits.
    at = np.zeros(model.camera.num_pixels, bool)
    at[view.points.pixel] = shaded.seen[0] > 0
    relative = np.abs(got - wanted).max(axis=1) / wanted.max(axis=1)
    assert at[pixel].sum() > 200
    assert relative[at[pixel]].max() < LARGEST, relative[at[pixel]].max()


def test_the_bound_would_notice_half_precision():
    """Were anything on the way half precision (5e-4), the bound would fail."""
    model = true_model(desk_scene(40, 30))
    albedo = model.pixels.albedo
    assert np.abs(albedo.astype(np.float16).astype(np.float32) / albedo - 1).max() > LARGEST
