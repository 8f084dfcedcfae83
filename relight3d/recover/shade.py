"""The texture of places on which hardly any photograph's light falls.

What such a place sends back in shadow is its albedo times indirect light that nobody knows well, but that changes slowly
along a smooth panel. So a panel's radiance in each photograph, less what is slow of it, is its texture, and a photograph
in which all of it is in shadow tells it as well as another. It must be the same in all photographs, and have edges:
what a corner keeps from the light is darker too, in all of them, but slowly.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32

from relight3d.records import Observations, ShadingPoints

MIN_POINTS = 100  # of a panel in one photograph's shadow, or light
MIN_SHARE = 0.25  # of a panel must ask: where most of it is told, what is beside a point says more
DARK = 5e-3  # of white: a photograph as dark as that tells nothing
MIN_ALIKE = 0.6  # correlation between two halves of the photographs
MIN_CONTRAST = 0.08  # standard deviation of the texture's logarithm
MIN_STEP, MIN_STEPS = 0.1, 0.04  # of the logarithm between neighbours, and how many of them must differ so
MOST = 1.6  # of the logarithm: a factor of five


@dataclass(frozen=True, eq=False)
class ShadeTexture:
    """What points differ by from their panel's median albedo, as a share of it, and where that was found."""

    away: Float64[np.ndarray, "point 3"]
    is_found: Bool[np.ndarray, " point"]


def texture_in_shade(
    observed: Observations,
    target: Float32[np.ndarray, "photo point 3"],
    direct: Float32[np.ndarray, "photo point color"],
    points: ShadingPoints,
    panel: Int[np.ndarray, " point"],
    is_asked: Bool[np.ndarray, " point"],
    near: Int32[np.ndarray, "pair 2"],
    white: float,
) -> ShadeTexture:
    """The texture of those panels of which enough points ask for it; of all of their points, since a median needs all.

    `target` is radiance without highlights, `panel` each point's smooth piece (-1 for none), `near` pairs of neighbours.
    """
    out = ShadeTexture(np.zeros((len(panel), 3)), np.zeros(len(panel), bool))
    asked = np.bincount(panel[is_asked & (panel >= 0)])
    size = np.bincount(panel[panel >= 0])[: len(asked)]
    wanted = np.flatnonzero(asked >= np.maximum(MIN_POINTS, MIN_SHARE * size))
    if len(wanted) == 0:
        return out
    usable = observed.is_safe & (observed.weight > 0) & observed.is_interior & ~(observed.is_lit & observed.is_highlight)
    usable, light = usable & ~observed.is_thrown, direct.max(axis=2)
    for one in wanted.tolist():
        mine = np.flatnonzero(panel == one)
        slow = _slow(points, mine)
        pairs = near[(panel[near] == one).all(axis=1)]
        found = _of_panel(target[:, mine], light[:, mine], usable[:, mine], slow, white)
        if found is not None and _has_edges(found, np.searchsorted(mine, pairs)):
            found -= np.median(found, axis=0)
            out.away[mine], out.is_found[mine] = np.expm1(np.clip(found, -MOST, MOST)), True
    return out


def _slow(points: ShadingPoints, mine: Int[np.ndarray, " some"]) -> Float64[np.ndarray, "some function"]:
    """Functions of the place and the normal that change slowly over a panel."""
    place, normal = points.position[mine].astype(np.float64), points.normal[mine].astype(np.float64)
    place = (place - place.mean(axis=0)) / max(float(place.std(axis=0).max()), 1e-30)
    products = [place[:, i] * place[:, j] for i in range(3) for j in range(i + 1)]
    return np.column_stack([np.ones(len(mine)), place, normal - normal.mean(axis=0), *products])


def _of_panel(
    target: Float32[np.ndarray, "photo some 3"],
    light: Float32[np.ndarray, "photo some"],
    usable: Bool[np.ndarray, "photo some"],
    slow: Float64[np.ndarray, "some function"],
    white: float,
) -> Float64[np.ndarray, "some 3"] | None:
    """The logarithm of a panel's texture; None where the photographs do not agree on one."""
    # In two halves, by turns.
    sums, weights, half = np.zeros((2, len(slow), 3)), np.zeros((2, len(slow), 1)), 0
    for radiance, falling, is_usable in zip(target, light, usable, strict=True):
        for here in (is_usable & (falling <= 0), is_usable & (falling > 0)):
            here = np.flatnonzero(here & (radiance.min(axis=1) > 0))
            level = float(np.median(radiance[here].mean(axis=1))) if len(here) >= MIN_POINTS else 0.0
            if level < DARK * white:
                continue
            values = np.log(radiance[here].astype(np.float64))
            if falling[here[0]] > 0:
                values -= np.log(falling[here].astype(np.float64))[:, None]
            functions = slow[here]
            ridge = 1e-9 * len(here) * np.eye(slow.shape[1])
            values -= functions @ np.linalg.solve(functions.T @ functions + ridge, functions.T @ values)
            weight = min(level / white, 1.0) ** 2
            sums[half, here] += weight * values
            weights[half, here] += weight
            half = 1 - half
    both = (weights > 0).all(axis=0)[:, 0]
    if both.sum() < MIN_POINTS:
        return None
    one, other = (sums[k] / np.maximum(weights[k], 1e-30) for k in (0, 1))
    spread = np.sqrt((one[both] ** 2).sum() * (other[both] ** 2).sum())
    alike = float((one[both] * other[both]).sum() / max(spread, 1e-30))
    found = sums.sum(axis=0) / np.maximum(weights.sum(axis=0), 1e-30)
    contrast = float(np.sqrt((found[both] ** 2).mean(axis=0).max()))
    if alike < MIN_ALIKE or contrast < MIN_CONTRAST:
        return None
    return found * (2 * alike / (1 + alike))  # Spearman and Brown: how far the mean of both halves is to be believed


def _has_edges(found: Float64[np.ndarray, "some 3"], pairs: Int[np.ndarray, "pair 2"]) -> bool:
    """Whether enough neighbours differ by a step."""
    step = np.abs(found[pairs[:, 0]] - found[pairs[:, 1]]).max(axis=1)
    return len(step) > 0 and float((step > MIN_STEP).mean()) >= MIN_STEPS
