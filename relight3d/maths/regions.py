"""Regions by what is alike, over a graph of what touches: feature and index arrays only.

Regions are compared by the `Moments` of their samples, with Bhattacharyya's distance of normal distributions: it grows
with the difference of the means, measured in the regions' own scatter, and with the ratio of the scatters. So a print
is like another print of its contrast although their means differ, and unlike a plain region of the same mean.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int32
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

PALETTE_SHARE = 0.35  # of the mean scatter, added in all directions: a print's few colours say little of the others


@dataclass(frozen=True, eq=False)
class Moments:
    """Sample count, mean and covariance of the features of each region."""

    count: Float64[np.ndarray, " region"]
    mean: Float64[np.ndarray, "region feature"]
    covariance: Float64[np.ndarray, "region feature feature"]


def region_moments(
    features: Float[np.ndarray, "sample feature"], region: Int[np.ndarray, " sample"], num_regions: int
) -> Moments:
    """Moments by region; all zero for a region without samples."""
    count = np.bincount(region, minlength=num_regions).astype(np.float64)
    safe = np.maximum(count, 1.0)
    mean = np.stack([np.bincount(region, x, num_regions) / safe for x in features.T], axis=1)
    away = (features - mean[region]).T
    rows = [[np.bincount(region, x * y, num_regions) / safe for y in away] for x in away]
    return Moments(count, mean, np.moveaxis(np.array(rows), 2, 0))


def united(parts: Moments, region: Int[np.ndarray, " part"], grows: bool) -> Moments:
    """The moments of regions put together; unless it `grows`, their scatter is the mean of the parts' own."""
    size, num_regions = parts.mean.shape[1], int(region.max(initial=-1)) + 1
    count = np.bincount(region, parts.count, num_regions)
    share = (parts.count / np.maximum(count, 1e-30)[region])[:, None]

    def summed(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(region, column, num_regions) for column in (share * values).T], axis=1)

    mean = summed(parts.mean)
    away = (parts.mean - mean[region]) * grows
    scatter = parts.covariance + away[:, :, None] * away[:, None, :]
    return Moments(count, mean, summed(scatter.reshape(-1, size * size)).reshape(-1, size, size))


def clip_tails(
    features: Float64[np.ndarray, "sample feature"],
    region: Int[np.ndarray, " sample"],
    num_regions: int,
    tail: float,
    slack: Float[np.ndarray, " feature"],
) -> Float64[np.ndarray, "sample feature"]:
    """Features brought to between their region's quantiles `tail` and 1 - `tail`, give or take `slack`."""
    count = np.bincount(region, minlength=num_regions)
    start, cut = np.cumsum(count) - count, (tail * count).astype(int)
    low, high = start + cut, start + np.maximum(count - 1 - cut, 0)
    out = np.empty_like(features)
    for i, column in enumerate(features.T):
        # Not the median and its scatter: of two colours in one region they would leave only the more frequent.
        ordered = np.append(column[np.lexsort((column, region))], 0.0)
        out[:, i] = np.clip(column, (ordered[low] - slack[i])[region], (ordered[high] + slack[i])[region])
    return out


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
    mean = np.trace(covariance, axis1=-2, axis2=-1) / len(floor)
    return covariance + np.diag(floor**2) + PALETTE_SHARE * mean[:, None, None] * np.eye(len(floor))


def merge_alike(
    moments: Moments,
    pairs: Int[np.ndarray, "pair 2"],
    floor: Float[np.ndarray, " feature"],
    limit: float,
    grows: bool = True,
    may_merge: Bool[np.ndarray, " pair"] | None = None,
) -> Int32[np.ndarray, " region"]:
    """Merge the most alike of the pairs, again and again, while they are nearer than `limit`. New numbers, 0 upward.

    A merged region's scatter is that of all its samples if it `grows`, else the mean of its parts' own: then a region
    that drifts does not grow more tolerant with every merge, until it swallows what is next to it. Pairs that may not
    merge stay apart through the merges of others. The loop runs over merges, of which there are fewer than regions,
    and measures again only what has changed.
    """
    moments = Moments(moments.count.copy(), moments.mean.copy(), moments.covariance.copy())
    pairs, label = np.array(pairs), np.arange(len(moments.count))
    is_apart = np.zeros(len(pairs), bool) if may_merge is None else ~may_merge
    distance = np.where(is_apart, np.inf, distances(moments, pairs, floor))
    while len(pairs) and distance.min() < limit:
        one, other = (int(end) for end in pairs[np.argmin(distance)])
        _merge_into(moments, one, other, grows)
        label[label == other] = one
        pairs[pairs == other] = one
        changed = np.flatnonzero((pairs == one).any(axis=1))
        partner = pairs[changed].sum(axis=1) - one
        is_apart[changed] |= np.isin(partner, partner[is_apart[changed]]) | (partner == one)
        distance[changed] = np.where(is_apart[changed], np.inf, distances(moments, pairs[changed], floor))
    return renumbered(label)


def _merge_into(moments: Moments, one: int, other: int, grows: bool) -> None:
    both = np.array([one, other])
    share = moments.count[both] / max(moments.count[both].sum(), 1e-30)
    away = moments.mean[one] - moments.mean[other]
    spread = share[0] * share[1] * np.outer(away, away) * grows
    moments.covariance[one] = np.einsum("r,rij->ij", share, moments.covariance[both]) + spread
    moments.mean[one] = share @ moments.mean[both]
    moments.count[one] = moments.count[both].sum()


def absorb(
    moments: Moments,
    pairs: Int[np.ndarray, "pair 2"],
    floor: Float[np.ndarray, " feature"],
    is_small: Bool[np.ndarray, " region"],
) -> Int32[np.ndarray, " region"]:
    """Give each small region to the touching region most like it, over other small ones if need be. New numbers.

    Small regions that touch no large one stay.
    """
    into = np.where(is_small, -1, np.arange(len(is_small)))
    both = np.concatenate([pairs, pairs[:, ::-1]])
    distance = np.tile(distances(moments, pairs, floor), 2)
    while True:
        is_next = (into[both[:, 0]] < 0) & (into[both[:, 1]] >= 0)
        small, near = both[is_next, 0], into[both[is_next, 1]]
        if len(small) == 0:
            return renumbered(np.where(into < 0, np.arange(len(into)), into))
        order = np.lexsort((distance[is_next], small))
        first = np.unique(small[order], return_index=True)[1]
        into[small[order][first]] = near[order][first]


def merge_interleaved(
    count: Float[np.ndarray, " region"],
    pairs: Int[np.ndarray, "pair 2"],
    border: Float[np.ndarray, " pair"],
    limit: float,
) -> Int32[np.ndarray, " region"]:
    """Merge what lies within others as the colours of a print do: much border for little area. New numbers.

    A region's measure is border^2 / (4 pi area): 1 for a disc on a ground, k for k discs, below 0.3 for one of two
    halves. The highest goes to the region it shares most of its border with. `border` counts pairs of pixels across it,
    which is 4 / pi times its length on the mean of all directions.
    """
    label, count = np.arange(len(count)), np.maximum(count, 1.0)
    table = np.zeros((len(count), len(count)))
    np.add.at(table, (pairs[:, 0], pairs[:, 1]), border * (np.pi / 4))
    table += table.T
    while len(count):
        measure = table.sum(axis=1) ** 2 / (4 * np.pi * count)
        one = int(np.argmax(measure))
        if measure[one] < limit:
            break
        other = int(np.argmax(table[one]))
        table[other] += table[one]
        table[:, other] += table[:, one]
        table[one] = table[:, one] = table[other, other] = 0.0
        count[other] += count[one]
        label[label == one] = other
    return renumbered(label)


# ------------------------------------------------------------------------------------------------ graphs


def renumbered(label: Int[np.ndarray, " node"]) -> Int32[np.ndarray, " node"]:
    """The same labels, numbered 0 upward without gaps."""
    return np.unique(label, return_inverse=True)[1].ravel().astype(np.int32)


def first_of_each(label: Int[np.ndarray, " node"]) -> Int[np.ndarray, " region"]:
    """The first member of each label, in the order of the labels."""
    return np.unique(label, return_index=True)[1]


def components(num_nodes: int, pairs: Int[np.ndarray, "pair 2"]) -> Int32[np.ndarray, " node"]:
    """The connected component of each node."""
    graph = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(num_nodes, num_nodes))
    return connected_components(graph, directed=False)[1].astype(np.int32)


def borders(
    region: Int[np.ndarray, "pair 2"], length: Float[np.ndarray, " pair"]
) -> tuple[Int32[np.ndarray, "border 2"], Float64[np.ndarray, " border"]]:
    """The pairs of different regions that touch, each once, and their summed lengths."""
    differs = region[:, 0] != region[:, 1]
    ordered = np.sort(region[differs], axis=1).astype(np.int64)
    size = int(ordered.max(initial=0)) + 1
    key, index = np.unique(ordered[:, 0] * size + ordered[:, 1], return_inverse=True)
    total = np.bincount(index.ravel(), length[differs], len(key)).astype(np.float64)
    return np.stack([key // size, key % size], axis=1).astype(np.int32), total


def pairs_within(group: Int[np.ndarray, " region"]) -> Int32[np.ndarray, "pair 2"]:
    """All pairs of regions of the same group."""
    order = np.argsort(group, kind="stable")
    found = [np.zeros((0, 2), np.int64)]
    for members in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        found.append(members[np.stack(np.triu_indices(len(members), 1), axis=1)])
    return np.concatenate(found).astype(np.int32)


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
