"""How frames share their work among threads, and the loops that fill vector registers by hand."""

import os
from threading import Barrier

import numba
import numpy as np
import pytest

from relight3d.relight import cast_kernels, kernels, lanes, ray_kernels
from relight3d.relight.light_rows import light_row
from relight3d.relight.tiles import counting
from relight3d.tracing import RayScene, over_threads
from tests.relight import models


def test_results_stand_in_the_order_of_the_parts() -> None:
    assert over_threads(lambda part: part * part, range(20)) == [part * part for part in range(20)]
    assert over_threads(lambda part: part, []) == []


def test_parts_run_at_the_same_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RELIGHT3D_THREADS", "3")
    together = Barrier(3, timeout=20)
    over_threads(lambda part: together.wait(), range(3))  # one after the other they would wait for ever


def test_work_may_ask_for_threads_itself() -> None:
    def work(part: int) -> int:
        return sum(over_threads(lambda other: part * other, range(5)))

    assert over_threads(work, range(6)) == [10 * part for part in range(6)]


def test_what_a_part_meets_is_raised_and_the_next_call_works() -> None:
    with pytest.raises(ZeroDivisionError):
        over_threads(lambda part: 1 / part, [1, 0, 2])
    assert over_threads(lambda part: 1 / part, [1, 2]) == [1, 0.5]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_process_has_its_own_threads() -> None:
    over_threads(lambda part: part, range(4))
    child = os.fork()
    if child == 0:
        os._exit(0 if over_threads(lambda part: part + 1, range(4)) == [1, 2, 3, 4] else 1)
    assert os.waitpid(child, 0)[1] == 0


@numba.njit(nogil=True)
def _visit(counter, num, visits):
    while True:
        place = kernels.take(counter)  # pyright: ignore[reportCallIssue]
        if place >= num:
            return
        visits[place] += 1


def test_every_tile_is_taken_once() -> None:
    visits = np.zeros(100_000, np.int64)
    counting(lambda counter: _visit(counter, len(visits), visits))
    assert (visits == 1).all()


@numba.njit
def _blend(source, share, table, column, out):
    for i in range(len(source)):
        lanes.blend_colors(source, share, i, table, column, out, 1, i)  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize("num_shares", [1, 3, 4])
@pytest.mark.parametrize("column", [0, 4])
def test_colours_are_blended_in_the_rows_asked_for(num_shares: int, column: int) -> None:
    rng = np.random.default_rng(num_shares)
    table, out = rng.random((9, 8), np.float32), np.zeros((5, 7), np.float32)
    source, share = rng.integers(0, 9, (7, num_shares)).astype(np.int32), rng.random((7, num_shares), np.float32)
    _blend(source, share, table, column, out)
    wanted = np.einsum("nk,nkc->cn", share, table[source, column : column + 3])
    np.testing.assert_allclose(out[1:4], wanted, rtol=1e-6)
    assert (out[[0, 4]] == 0).all()


@pytest.mark.parametrize("light", [models.SUN, models.LAMP])
def test_points_in_a_row_and_scattered_ones_get_the_same_shadows(light) -> None:
    model = models.full()
    points, scene = model.pixels.points, RayScene(model.mesh.centered_vertices, model.mesh.faces)
    if scene.packets is None:
        pytest.skip("no packets here")
    packets, num = scene.packets, len(points)
    position, geometric = np.ascontiguousarray(points.position.T), np.ascontiguousarray(points.geometric_normal.T)
    addresses, offset = (packets.occluded, packets.scene, packets.arguments), np.float32(scene.offset_distance)

    def states(lists: list) -> np.ndarray:
        state, seen = np.zeros(num, np.uint8), np.full(num, 7, np.uint8)
        for index in lists:
            given = (index.astype(np.int32), state, seen)
            cast_kernels.cast_listed(addresses, light_row(light)[None], position, geometric, offset, *given)
        assert ((seen == kernels.FULL) == (state == ray_kernels.LIT)).all()
        return state

    every, odd = np.arange(num), np.arange(num) % 2 == 1
    assert (states([every]) == states([every[odd], every[~odd]])).all()
