"""The suite notices: each safeguard is taken out in turn, and a named check must fail without it."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from relight3d import shading, tracing
from relight3d.evaluate.scenes import desk_scene, hemisphere_lights
from relight3d.evaluate.world import World
from relight3d.lights import DirectionalLight
from relight3d.maths import lafortune, least_squares, light_basis
from relight3d.records import PatchMesh
from relight3d.recover import bounce
from relight3d.shading import cast_light, points_seen
from tests.stability import fit_cases

SCENE = desk_scene(48, 36)


def check_no_false_shadow():
    """Under a light straight above, the open table and the box's and sphere's upper sides are lit."""
    world = World(SCENE)
    points = points_seen(world.rays, world.mesh, SCENE.camera)
    lit = cast_light(world.rays, points, DirectionalLight((0.0, 0.0, 1.0), 1.0))
    open_up = (points.normal[:, 2] > 0.2) & (world.object_of_face[points.face] != 0)
    assert open_up.sum() > 20
    # Nothing is above the tops: not one false shadow.
    assert lit.is_lit[open_up].all()


def check_shadows_far_away():
    """A million metres from the origin the same points are lit as at home."""
    lights = [each[0] for each in hemisphere_lights(4)]

    def lit_points(offset):
        moved = replace(SCENE, mesh=replace(SCENE.mesh, vertices=SCENE.mesh.vertices + offset))
        world = World(moved)
        points = points_seen(world.rays, world.mesh, SCENE.camera.translated(offset))
        return len(points), [cast_light(world.rays, points, light).is_lit.mean() for light in lights]

    near, far = lit_points(np.zeros(3)), lit_points(np.array([1e6, -7e5, 3e5]))
    assert near[0] == far[0]
    np.testing.assert_allclose(near[1], far[1], atol=2e-3)  # two points of a thousand on a border


def check_weak_direction_is_damped():
    """Lights within a degree: noise of 1 % must not become an answer of 100 times its size."""
    rng = np.random.default_rng(0)
    omega = np.array([0.0, 0.0, 1.0]) + 0.01 * rng.standard_normal((12, 3))
    omega /= np.linalg.norm(omega, axis=1, keepdims=True)
    rows = light_basis.evaluate_basis("sh2", omega)[None]
    target = 1.0 + 0.01 * rng.standard_normal((1, 12, 1))
    gram = np.einsum("nru,nrv->nuv", rows, rows)
    moment = np.einsum("nru,nrk->nuk", rows, target)
    answer = least_squares.solve_normal(gram, moment, damping=2e-3 * light_basis.degree_of("sh2") ** 2)
    away = light_basis.evaluate_basis("sh2", np.array([[1.0, 0.0, 0.0]]))
    assert abs(float((away @ answer.value[0])[0, 0])) < 10.0


def check_extrapolation_is_clamped():
    """A light opposite to all photographed ones is read within reach of them."""
    anchors = np.array([[0.0, 0.0, 1.0]])
    below = light_basis.within_reach(np.array([[0.6, 0.0, -0.8]]), anchors, np.radians(20))[0]
    assert below[0] @ anchors[0] > np.cos(np.radians(20)) - 1e-9


def check_equal_columns_share():
    """Two equal columns of a minimum-norm solve share the answer."""
    column = np.linspace(1, 2, 6)
    matrix = np.stack([column, column * (1 + 1e-15)], axis=1)[None]
    answer = least_squares.solve_rows(matrix, 2 * column[None, :, None])
    assert answer.rank[0] == 1 and answer.status[0] == least_squares.Status.RANK_DEFICIENT
    np.testing.assert_allclose(answer.value[0, :, 0], 1.0, atol=1e-6)


def check_negative_base():
    assert fit_cases.base_at_zero().status == "ok"


def check_a_white_box_does_not_blow_up():
    """Six white walls that see each other and nothing else: after any number of bounces the light is bounded.

    Albedo is fitted, and comes out above 1 where a lamp is stronger than its file says. At 0.95, the most that counts,
    all bounces together are the sum of 0.95^k from k = 1: 19 times the direct light.
    """
    num = 6
    box = bounce.Transport(
        surface=np.zeros(num, np.int32),
        seen=sp.csr_matrix((1 - np.eye(num, dtype=np.float32)) / (num - 1)),  # all of each hemisphere is filled
        mirrored=(),
        own=np.ones((num, 1), np.float32),
        thrown=np.zeros((0, num, 1), np.float32),
        lights=(DirectionalLight((0.0, 0.0, 1.0), 1.0),),
        hear=sp.identity(num, format="csr", dtype=np.float32),
        to_sites=sp.identity(num, format="csr", dtype=np.float32),
        positions=np.zeros((num, 3), np.float32),
    )
    for albedo in (1.0, 1.5):
        of_points, of_surface = np.full((num, 3), albedo, np.float32), np.full((1, 3), albedo)
        arrived = bounce.bounced(box, of_points, of_surface, (), num_bounces=400)
        # float32 rounds 400 sums; 0.95^400 = 1e-9 is missing.
        np.testing.assert_allclose(arrived, 19.0, rtol=1e-3)


@pytest.mark.parametrize(
    "check",
    [
        check_no_false_shadow,
        check_shadows_far_away,
        check_weak_direction_is_damped,
        check_extrapolation_is_clamped,
        check_equal_columns_share,
        check_negative_base,
        check_a_white_box_does_not_blow_up,
        fit_cases.flat_face_distant_light,
        fit_cases.zero_gradient,
    ],
)
def test_check_passes_as_things_are(check):
    check()


def test_without_the_ray_offset_surfaces_shadow_themselves(monkeypatch):
    monkeypatch.setattr(tracing, "OFFSET_ULPS", 0)
    with pytest.raises(AssertionError):
        check_no_false_shadow()


def test_without_recentring_a_far_scene_falls_apart(monkeypatch):
    monkeypatch.setattr(PatchMesh, "center", np.zeros(3))
    with pytest.raises(AssertionError):
        check_shadows_far_away()


def test_without_damping_noise_is_magnified(monkeypatch):
    solve = least_squares.solve_normal
    monkeypatch.setattr(least_squares, "solve_normal", lambda *a, **k: solve(*a, **{**k, "damping": 0.0}))
    with pytest.raises(AssertionError):
        check_weak_direction_is_damped()


def test_without_the_reach_a_fit_is_read_anywhere(monkeypatch):
    monkeypatch.setattr(light_basis, "within_reach", lambda omega, anchors, reach: (omega, np.zeros(len(omega))))
    with pytest.raises(AssertionError):
        check_extrapolation_is_clamped()


def test_without_the_rank_cut_rounding_becomes_an_answer(monkeypatch):
    def all_count(singular, larger, unknowns):
        rank = np.full(len(singular), unknowns, np.int32)
        return rank, np.ones(len(singular)), singular > 0

    monkeypatch.setattr(least_squares, "_rank", all_count)
    with pytest.raises(AssertionError):
        check_equal_columns_share()


def test_without_the_clamp_a_negative_base_is_nan(monkeypatch):
    def unclamped(base, exponent):
        with np.errstate(all="ignore"):
            return np.asarray(base) ** exponent

    monkeypatch.setattr(fit_cases, "power", unclamped)
    assert shading.power is lafortune.power  # the forward model uses the one that is checked
    with pytest.raises(AssertionError):
        check_negative_base()


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_without_the_clamp_of_albedo_bounces_never_end(monkeypatch):
    monkeypatch.setattr(np, "clip", lambda value, low, high: np.maximum(value, low))
    with pytest.raises(AssertionError):
        check_a_white_box_does_not_blow_up()
