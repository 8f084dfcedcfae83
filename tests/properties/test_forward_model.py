"""What the forward model claims to be: reciprocal, linear, additive, and blind to where the scene stands."""

from dataclasses import replace
from functools import cache

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from relight3d.evaluate.scenes import Scene, desk_scene
from relight3d.evaluate.truth import true_model
from relight3d.lights import DirectionalLight, PointLight, SpotLight
from relight3d.maths.lafortune import lobe_base, lobe_energy, power
from relight3d.records import Indirect, Lobe, RelightModel
from relight3d.recover.specular import within_energy
from relight3d.relight.relighter import Relighter

# Tracing and a whole frame in each example; the machine is shared.
FRAMES = settings(max_examples=6, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
NUMBERS = settings(max_examples=200, deadline=None, derandomize=True)

unit = st.floats(-1, 1, allow_nan=False)
directions = st.tuples(unit, unit, unit).filter(lambda d: np.linalg.norm(d) > 0.1).map(lambda d: d / np.linalg.norm(d))
above = directions.map(
    lambda d: np.array([d[0], d[1], abs(d[2]) + 0.05]) / np.linalg.norm([d[0], d[1], abs(d[2]) + 0.05])
)


seeds = st.integers(0, 10**6)


def light_of(seed: int):
    """A light of any kind over the desk. (Not drawn by hypothesis piece by piece: a frame is too slow to shrink.)"""
    rng = np.random.default_rng(seed)
    toward = rng.standard_normal(3)
    toward[2] = abs(toward[2]) + 0.05
    toward /= np.linalg.norm(toward)
    color = tuple(rng.uniform(0, 10, 3) * (rng.random(3) < 0.8))
    kind = ("directional", "point", "spot")[seed % 3]
    if kind == "directional":
        return DirectionalLight(tuple(toward), color)
    place = tuple(3.0 * toward)
    return PointLight(place, color) if kind == "point" else SpotLight(place, tuple(-toward), color, 0.2, 0.6)


def glossy_model(scene: Scene) -> RelightModel:
    """The desk's truth with an indirect part of its own, so that every term takes part."""
    model = true_model(scene)
    rng = np.random.default_rng(0)
    num = len(model.mesh.faces)
    # Positive for every direction: where a fit goes below zero it is cut there, and no longer adds up.
    coefficients = rng.uniform(-0.03, 0.03, (num, 4, 3)).astype(np.float32)
    coefficients[:, 0] = 0.1
    anchors = np.array([[0.0, 0.0, 1.0]])
    indirect = Indirect("linear", "face", coefficients, np.zeros((num, 3), np.float32), anchors, np.pi, 0.5, True)
    return replace(model, indirect=indirect)


@cache
def desk() -> tuple[Scene, Relighter]:
    scene = desk_scene(40, 30, glossy=True, mirror=True)
    return scene, Relighter(glossy_model(scene))


def render(*each) -> np.ndarray:
    return desk()[1].render(list(each)).radiance.astype(np.float64)


@NUMBERS
@given(directions, above, above, st.floats(1.0, 1e4), st.floats(0.3, 1.0))
def test_isotropic_lobes_are_reciprocal(normal, light, viewer, exponent, ratio):
    axes = np.array([-ratio, -ratio, 1.0])
    one, two = (
        power(lobe_base(normal[None], a[None], b[None], axes), exponent) for a, b in ((light, viewer), (viewer, light))
    )
    # The base is symmetric to the last bit but for the order of a sum; the power magnifies it by the exponent.
    np.testing.assert_allclose(one, two, rtol=1e-15 * exponent * 10 + 1e-12)


@NUMBERS
@given(above, above, st.floats(1.0, 1e4), st.floats(0.1, 1.0), st.floats(0.1, 1.0), directions)
def test_anisotropic_lobes_are_reciprocal(light, viewer, exponent, c_x, c_y, along):
    normal, axes = np.array([[0.0, 0.0, 1.0]]), np.array([-c_x, -c_y, 1.0])
    one, two = (
        power(lobe_base(normal, a[None], b[None], axes, along), exponent) for a, b in ((light, viewer), (viewer, light))
    )
    np.testing.assert_allclose(one, two, rtol=1e-15 * exponent * 10 + 1e-12)


@NUMBERS
@given(st.lists(st.tuples(st.floats(1.0, 1e4), st.floats(0.5, 1.0), st.floats(1e-3, 1e4)), min_size=1, max_size=3))
def test_recovered_lobes_keep_to_an_energy_of_one(parameters):
    lobes = tuple(Lobe(np.full(3, color), np.array([-r, -r, 1.0]), n, np.zeros(3)) for n, r, color in parameters)
    limited = within_energy(lobes)
    energy = sum(lobe.color.max() * lobe_energy(lobe.axes, lobe.exponent) for lobe in limited)
    assert energy <= 1 + 1e-9


@FRAMES
@given(seeds, st.floats(1e-3, 1e3))
def test_frames_are_linear_in_intensity(seed, factor):
    light = light_of(seed)
    # Light is multiplied last, in float32: two roundings of 6e-8, and sums of a few terms.
    one, scaled = render(light), render(light.scaled(factor)) / factor
    np.testing.assert_allclose(scaled, one, rtol=1e-6, atol=1e-6 * max(one.max(), 1e-12))


@FRAMES
@given(seeds, seeds)
def test_frames_add_up_over_lights(first, second):
    one, two = light_of(first), light_of(second)
    together, apart = render(one, two), render(one) + render(two)
    np.testing.assert_allclose(together, apart, rtol=1e-5, atol=1e-6 * max(apart.max(), 1e-12))


@FRAMES
@given(seeds, st.permutations([0, 1, 2]))
def test_frames_follow_a_permutation_of_colours(seed, order):
    light = light_of(seed)
    scene, _ = desk()
    model = glossy_model(scene)
    order = list(order)
    turned = replace(
        model,
        surface_albedo=model.surface_albedo[:, order],
        pixels=replace(model.pixels, albedo=np.ascontiguousarray(model.pixels.albedo[:, order])),
        indirect=replace(
            model.indirect,
            coefficients=np.ascontiguousarray(model.indirect.coefficients[..., order]),
            ambient=np.ascontiguousarray(model.indirect.ambient[:, order]),
        ),
        lobes=tuple(tuple(replace(lobe, color=lobe.color[order]) for lobe in each) for each in model.lobes),
        mirrors=tuple(replace(m, reflectance=m.reflectance[order]) for m in model.mirrors),
    )
    color = light.power[order]
    painted = replace(light, irradiance=color) if light.kind == "directional" else light
    if light.kind == "point":
        painted = replace(light, intensity=color)
    elif light.kind == "spot":
        painted = light.moved(intensity=tuple(color))
    got = Relighter(turned).render([painted]).radiance
    np.testing.assert_allclose(got, render(light)[..., order], rtol=1e-5, atol=1e-6 * max(float(got.max()), 1e-12))


def moved_scene(scene: Scene, turn: np.ndarray, shift: np.ndarray, size: float) -> Scene:
    """Mesh and camera turned, then scaled, then moved."""
    mesh, pose = scene.mesh, scene.camera.world_from_camera.copy()
    pose[:3, :3] = turn @ pose[:3, :3]
    pose[:3, 3] = size * turn @ pose[:3, 3] + shift
    mesh = replace(
        mesh,
        vertices=size * mesh.vertices @ turn.T + shift,
        vertex_normals=(mesh.vertex_normals @ turn.T).astype(np.float32),
    )
    return replace(scene, mesh=mesh, camera=replace(scene.camera, world_from_camera=pose))


def moved_light(light, turn, shift, size):
    if light.kind == "directional":
        return replace(light, to_light=tuple(turn @ np.asarray(light.to_light)))
    place, color = tuple(size * turn @ np.asarray(light.position) + shift), tuple(size**2 * light.power)
    if light.kind == "point":
        return PointLight(place, color)
    return light.moved(position=place, direction=tuple(turn @ np.asarray(light.direction)), intensity=color)


@FRAMES
@given(seeds, directions, st.floats(-np.pi, np.pi), st.tuples(*[st.floats(-1e3, 1e3)] * 3), st.floats(1e-2, 1e2))
def test_frames_do_not_know_where_the_scene_stands(seed, axis, angle, shift, size):
    light = light_of(seed)
    cross = np.cross(np.eye(3), axis)
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    scene = desk_scene(40, 30, glossy=True)
    there = moved_scene(scene, turn, np.array(shift), size)
    one = Relighter(true_model(scene)).render([light]).radiance
    two = Relighter(true_model(there)).render([moved_light(light, turn, np.array(shift), size)]).radiance
    # Radiance to 1e-4 of white, but for pixels on outlines and shadow borders, where the last digit of a ray decides.
    apart = np.abs(two - one).max(axis=2) > 1e-4 * max(float(one.max()), 1e-12)
    assert apart.mean() < 0.01, apart.mean()


def test_frames_do_not_know_the_order_of_the_faces():
    scene = desk_scene(40, 30, glossy=True)
    order = np.random.default_rng(0).permutation(len(scene.mesh.faces))
    mesh = scene.mesh
    shuffled = replace(
        mesh, faces=mesh.faces[order], corner_uvs=mesh.corner_uvs[order], object_id=mesh.object_id[order]
    )
    light = PointLight((0.5, -0.8, 2.0), (4.0, 3.0, 2.0))
    one = Relighter(true_model(scene)).render([light]).radiance
    two = Relighter(true_model(replace(scene, mesh=shuffled))).render([light]).radiance
    apart = np.abs(two - one).max(axis=2) > 1e-5 * one.max()
    assert apart.mean() < 0.005  # a ray through an edge belongs to either face
