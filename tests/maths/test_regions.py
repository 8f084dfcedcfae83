"""Regions: what is alike, what lies within what, and what is nearest along a graph."""

import numpy as np
import pytest

from relight3d.maths import regions

FLOOR = np.array([0.2, 0.1, 0.1])


def moments(*means, count=100.0, scatter=0.0):
    mean = np.array(means, dtype=np.float64)
    return regions.Moments(np.full(len(mean), count), mean, np.tile(np.eye(3) * scatter**2, (len(mean), 1, 1)))


def pairs_of(*pairs):
    return np.array(pairs, dtype=np.int32).reshape(-1, 2)


def picture_borders(label):
    """Regions of a label image: areas, touching pairs and border lengths."""
    number = label.ravel()
    grid = np.arange(label.size).reshape(label.shape)
    near = np.concatenate(
        [np.stack([grid[:, :-1].ravel(), grid[:, 1:].ravel()], 1), np.stack([grid[:-1].ravel(), grid[1:].ravel()], 1)]
    )
    return np.bincount(number).astype(float), *regions.borders(number[near], np.ones(len(near)))


def test_moments_are_those_of_the_samples_and_add_up():
    samples = np.random.default_rng(0).normal(size=(300, 3)) * (1.0, 2.0, 0.5)
    part = np.arange(300) % 3
    parts = regions.region_moments(samples, part, 3)
    np.testing.assert_allclose(parts.covariance[1], np.cov(samples[part == 1].T, bias=True), atol=1e-12)
    whole = regions.united(parts, np.zeros(3, np.int32), grows=True)
    np.testing.assert_allclose(whole.mean[0], samples.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(whole.covariance[0], np.cov(samples.T, bias=True), atol=1e-12)


def test_the_distance_is_an_eighth_of_the_squared_difference_in_scatters():
    pair = pairs_of((0, 1))
    found = regions.distances(moments((0, 0, 0), (0.4, 0.1, 0)), pair, FLOOR)
    np.testing.assert_allclose(found, [(2.0**2 + 1.0**2) / 8], rtol=1e-12)
    both = regions.Moments(np.full(2, 9.0), np.zeros((2, 3)), np.stack([np.zeros((3, 3)), 4.0 * np.diag(FLOOR**2)]))
    assert regions.distances(both, pair, FLOOR)[0] > 0.3, "a print is not like a plain region of its mean"


def test_a_drifting_region_does_not_swallow_what_it_is_unlike():
    drift = moments(*[(0.15 * i, 0, 0) for i in range(8)], (0, 0.5, 0))
    chain = pairs_of(*[(i, i + 1) for i in range(8)])
    label = regions.merge_alike(drift, chain, FLOOR, 0.5, grows=False)
    assert len(np.unique(label[:8])) < 8 and label[8] not in label[:8]


def test_what_may_not_merge_stays_apart_through_others():
    alike = moments((0, 0, 0), (0.01, 0, 0), (0.02, 0, 0))
    every = pairs_of((0, 1), (1, 2), (0, 2))
    assert regions.merge_alike(alike, every, FLOOR, 0.5).max() == 0
    label = regions.merge_alike(alike, every, FLOOR, 0.5, may_merge=np.array([True, True, False]))
    assert label[0] != label[2] and label.max() == 1


def test_small_regions_go_to_what_they_are_most_like_even_over_small_ones():
    found = regions.absorb(
        moments((0, 0, 0), (1, 0, 0), (0.9, 0, 0), (0.1, 0, 0), (5, 5, 5)),
        pairs_of((0, 2), (1, 2), (2, 3)),
        FLOOR,
        np.array([False, False, True, True, True]),
    )
    assert found[2] == found[1] != found[0], "the liker of two neighbours"
    assert found[3] == found[2], "reached over a small one"
    assert np.sum(found == found[4]) == 1, "touches none: stays"


@pytest.mark.parametrize(("number", "joins"), [(1, False), (2, False), (6, True), (20, True)])
def test_discs_on_a_ground_are_a_print_from_the_limit_on(number, joins):
    label = np.zeros((150, 150), int)
    rows, columns = np.mgrid[:150, :150]
    for k in range(number):
        label[np.hypot(rows - 15 - 30 * (k // 5), columns - 15 - 30 * (k % 5)) < 11] = 1
    # 4 % of slack about the limit of 3.5 discs: the mean over all directions is not exact for a digital disc.
    assert (regions.merge_interleaved(*picture_borders(label), limit=3.5).max() == 0) == joins


def test_a_mosaic_of_many_colours_is_one_print_and_stripes_of_materials_are_not():
    mosaic = np.random.default_rng(1).integers(0, 12, (20, 20)).repeat(8, axis=0).repeat(8, axis=1)
    assert regions.merge_interleaved(*picture_borders(mosaic), limit=3.5).max() == 0
    thirds = np.zeros((90, 90), int) + np.arange(90) // 30
    assert regions.merge_interleaved(*picture_borders(thirds), limit=3.5).max() == 2


def test_the_nearest_label_is_found_along_the_graph():
    label = np.array([5, -1, -1, -1, 7, -1], np.int32)
    chain = pairs_of((0, 1), (1, 2), (2, 3), (3, 4))
    found = regions.nearest_labelled(label, chain, np.array([1.0, 1.0, 5.0, 0.0]))
    np.testing.assert_array_equal(found, [5, 5, 5, 7, 7, -1])


def test_tails_are_clipped_and_two_colours_are_not():
    values = np.zeros((101, 3))
    values[50] = 1e6
    calm = regions.clip_tails(values, np.zeros(101, np.int32), 1, 0.1, FLOOR)
    np.testing.assert_allclose(calm[50], FLOOR)
    two = np.tile(np.where(np.arange(100) < 30, 5.0, 0.0)[:, None], 3)
    np.testing.assert_array_equal(regions.clip_tails(two, np.zeros(100, np.int32), 1, 0.1, FLOOR), two)
    assert regions.clip_tails(np.zeros((0, 3)), np.zeros(0, np.int32), 2, 0.1, FLOOR).shape == (0, 3)


def test_pairs_and_borders_are_each_named_once():
    assert {tuple(p) for p in regions.pairs_within(np.array([3, 1, 3, 1, 3]))} == {(0, 2), (0, 4), (2, 4), (1, 3)}
    assert regions.pairs_within(np.zeros(0, np.int32)).shape == (0, 2)
    pairs, length = regions.borders(pairs_of((0, 1), (1, 0), (2, 2), (2, 1)), np.array([1.0, 2.0, 9.0, 4.0]))
    np.testing.assert_array_equal(pairs, [[0, 1], [1, 2]])
    np.testing.assert_array_equal(length, [3.0, 4.0])
    assert len(regions.borders(pairs_of(), np.zeros(0))[0]) == 0
