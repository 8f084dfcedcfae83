"""Regions of a graph and of an image by what is alike: index and feature arrays only.

A region is a number per node (-1: none). `Moments` are what regions are compared by: they add up when regions merge, so
merging costs nothing. The distance is Bhattacharyya's for normal distributions: it grows with the difference of the
means measured in the regions' own scatter, and with the ratio of the scatters, so a textured region is like another
of its contrast although their means differ, and unlike a plain one of the same mean.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int32
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra


@dataclass(frozen=True, eq=False)
class Moments:
    """Sample count, mean and covariance of the features of each region."""

    count: Float64[np.ndarray, " region"]
    mean: Float64[np.ndarray, "region feature"]
    covariance: Float64[np.ndarray, "region feature feature"]


def components(num_nodes: int, pairs: Int[np.ndarray, "pair 2"]) -> Int32[np.ndarray, " node"]:
    """The connected component of each node."""
    graph = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(num_nodes, num_nodes))
    return connected_components(graph, directed=False)[1].astype(np.int32)


def region_moments(
    features: Float[np.ndarray, "sample feature"], region: Int[np.ndarray, " sample"], num_regions: int
) -> Moments:
    """Moments by region; samples of region -1 are left out, a region without samples has count, mean and scatter 0."""
    kept = region >= 0
    x, region = features[kept].astype(np.float64), region[kept]
    count = np.bincount(region, minlength=num_regions).astype(np.float64)
    safe = np.maximum(count, 1.0)
    size = x.shape[1]
    mean = np.stack([np.bincount(region, x[:, i], num_regions) / safe for i in range(size)], axis=1)
    away = x - mean[region]
    covariance = np.empty((num_regions, size, size))
    for i in range(size):
        for j in range(i, size):
            product = np.bincount(region, away[:, i] * away[:, j], num_regions) / safe
            covariance[:, i, j] = covariance[:, j, i] = product
    return Moments(count, mean, covariance)


def distances(
    moments: Moments, pairs: Int[np.ndarray, "pair 2"], floor: Float[np.ndarray, " feature"]
) -> Float64[np.ndarray, " pair"]:
    """Bhattacharyya's distance of pairs of regions; `floor` is the scatter that every feature has at least."""
    a, b = (_widened(moments.covariance[side], floor) for side in pairs.T)
    middle = (a + b) / 2
    gap = moments.mean[pairs[:, 0]] - moments.mean[pairs[:, 1]]
    mahalanobis = np.einsum("pi,pi->p", gap, np.linalg.solve(middle, gap[..., None])[..., 0])
    volume = np.linalg.slogdet(middle)[1] - (np.linalg.slogdet(a)[1] + np.linalg.slogdet(b)[1]) / 2
    return mahalanobis / 8 + volume / 2


def _widened(covariance: np.ndarray, floor: np.ndarray) -> np.ndarray:
    # A part of the scatter counts in all directions: the few colours of a print say little about those it lacks.
    size = covariance.shape[-1]
    mean = np.trace(covariance, axis1=-2, axis2=-1) / size
    return covariance + np.diag(floor**2) + 0.25 * mean[:, None, None] * np.eye(size)


def merge_alike(
    moments: Moments, pairs: Int[np.ndarray, "pair 2"], floor: Float[np.ndarray, " feature"], limit: float
) -> Int32[np.ndarray, " region"]:
    """Merge the most alike of the pairs, again and again, while they are nearer than `limit`. New numbers, 0 upward.

    The loop runs over merges, of which there are fewer than regions, and measures again only what has changed.
    """
    moments = Moments(moments.count.copy(), moments.mean.copy(), moments.covariance.copy())
    pairs = np.array(pairs)
    label = np.arange(len(moments.count))
    distance = distances(moments, pairs, floor)
    while len(pairs) and distance.min() < limit:
        one, other = pairs[np.argmin(distance)]
        _merge_into(moments, one, other)
        label[label == other] = one
        pairs[pairs == other] = one
        changed = np.flatnonzero((pairs == one).any(axis=1))
        distance[changed] = distances(moments, pairs[changed], floor)
        distance[pairs[:, 0] == pairs[:, 1]] = np.inf
    return np.unique(label, return_inverse=True)[1].astype(np.int32)


def _merge_into(moments: Moments, one: int, other: int) -> None:
    both = np.array([one, other])
    share = moments.count[both] / max(moments.count[both].sum(), 1e-30)
    away = moments.mean[one] - moments.mean[other]
    spread = share[0] * share[1] * np.outer(away, away)
    moments.covariance[one] = np.einsum("r,rij->ij", share, moments.covariance[both]) + spread
    moments.mean[one] = share @ moments.mean[both]
    moments.count[one] = moments.count[both].sum()


def distinct_pairs(pairs: Int[np.ndarray, "pair 2"]) -> Int32[np.ndarray, "pair 2"]:
    """Each unordered pair of different numbers once, the lower first."""
    pairs = np.sort(pairs, axis=1)
    return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0).astype(np.int32)


def pairs_within(group: Int[np.ndarray, " region"]) -> Int32[np.ndarray, "pair 2"]:
    """All pairs of regions of the same group."""
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    parts = [np.stack(np.triu_indices(len(each), 1), axis=1) for each in np.split(order, starts[1:])]
    groups = np.split(order, starts[1:])
    found = [members[pairs] for members, pairs in zip(groups, parts)]
    return np.concatenate(found).astype(np.int32) if found else np.zeros((0, 2), np.int32)


def borders(
    region: Int[np.ndarray, "pair 2"],
) -> tuple[Int32[np.ndarray, "border 2"], Float64[np.ndarray, " border"]]:
    """The pairs of regions that neighbouring samples belong to, each once, and by how many samples they touch."""
    region = np.sort(region[region[:, 0] != region[:, 1]], axis=1)
    if len(region) == 0:
        return np.zeros((0, 2), np.int32), np.zeros(0)
    pairs, length = np.unique(region, axis=0, return_counts=True)
    return pairs.astype(np.int32), length.astype(np.float64)


def nearest_labelled(
    label: Int[np.ndarray, " node"], pairs: Int[np.ndarray, "pair 2"], length: Float[np.ndarray, " pair"]
) -> Int32[np.ndarray, " node"]:
    """Give every node of label -1 that of the nearest labelled node along the graph; -1 where none is connected."""
    known = np.flatnonzero(label >= 0)
    if len(known) == 0 or len(known) == len(label):
        return label.astype(np.int32)
    # A weight of 0 would be no edge at all in a sparse graph.
    graph = coo_array((np.maximum(length, 1e-12), (pairs[:, 0], pairs[:, 1])), shape=(len(label), len(label))).tocsr()
    _, _, source = dijkstra(graph, directed=False, indices=known, min_only=True, return_predecessors=True)
    return np.where(source >= 0, label[np.maximum(source, 0)], -1).astype(np.int32)


def most_alike_neighbour(
    moments: Moments,
    pairs: Int[np.ndarray, "pair 2"],
    floor: Float[np.ndarray, " feature"],
    is_small: Bool[np.ndarray, " region"],
) -> Int32[np.ndarray, " region"]:
    """For each small region the large neighbour most like it, across other small ones if need be; itself if none."""
    into = np.where(is_small, -1, np.arange(len(is_small)))
    distance = distances(moments, pairs, floor)
    both, length = np.concatenate([pairs, pairs[:, ::-1]]), np.concatenate([distance, distance])
    while True:
        waits = (into[both[:, 0]] < 0) & (into[both[:, 1]] >= 0)
        small, near = both[waits, 0], into[both[waits, 1]]
        if len(small) == 0:
            return np.where(into < 0, np.arange(len(into)), into).astype(np.int32)
        order = np.lexsort((length[waits], small))
        first = np.unique(small[order], return_index=True)[1]
        into[small[order][first]] = near[order][first]


def merge_interleaved(
    count: Float[np.ndarray, " region"],
    pairs: Int[np.ndarray, "pair 2"],
    border: Float[np.ndarray, " pair"],
    limit: float,
) -> Int32[np.ndarray, " region"]:
    """Merge what lies within each other as the colours of a print do: many borders for little area. New numbers.

    Two regions are interleaved by border^2 / (4 pi area of the smaller): 1 for a disc on a ground, k for k discs, 0.3 or
    less for two halves.
    """
    label, count = np.arange(len(count)), np.array(count, np.float64)
    size = len(count)
    table = np.zeros((size, size))
    np.add.at(table, (pairs[:, 0], pairs[:, 1]), border)
    table += table.T
    while True:
        interleaving = table**2 / (4 * np.pi * np.maximum(np.minimum.outer(count, count), 1.0))
        np.fill_diagonal(interleaving, 0.0)
        one, other = np.unravel_index(np.argmax(interleaving), table.shape) if size else (0, 0)
        if size == 0 or interleaving[one, other] < limit:
            return np.unique(label, return_inverse=True)[1].astype(np.int32)
        table[one] += table[other]
        table[:, one] += table[:, other]
        table[other] = table[:, other] = 0.0
        count[one] += count[other]
        label[label == other] = one
