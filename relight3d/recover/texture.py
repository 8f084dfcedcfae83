"""Textured surfaces and their de-lit texture: sections 1.1.1 and 1.2.2, eq. (2) and (3), Wu et al. 2004.

A surface is textured when neighbouring pixels differ strongly and by the same factor in every photograph: a factor that
changes with the light is relief, not texture. The de-lit texture is per pixel: by default from the same least squares
as everything else (diffuse.pixel_albedo), or on demand by the paper's eq. (2), linear in the reciprocals, which has no
say in how noise is weighed. The texture-free mean of eq. (3) is what indirect.gather sums to each site: radiance over
albedo, weighted.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float32, Float64, Int32

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.maths.least_squares import Solution, Status, robust_scale
from relight3d.records import Observations, ShadingPoints

TELLING = 0.02  # of the largest error: a photograph with so much says something of a gain
UNLIKE = 1.5  # times the surface's albedo: where light falls freely, indirect light is no such part of it
BLOCK_PX = 4  # pixels along a side that are summed: noise of single ones would pass for paint


@dataclass(frozen=True)
class TextureOptions:
    """When a surface counts as textured, and how its texture is found."""

    min_difference: float = 0.06  # between neighbours, as a factor: what a texture must show somewhere
    min_share: float = 0.04  # of the pixels at least must show it
    min_spread: float = 0.15  # or the albedo must vary by so much (relative) over the surface as a whole
    min_gain_db: float = 0.15  # of left-out photographs, for an albedo per pixel where the measure sees no texture
    method: str = "alternating"  # or "reciprocal": eq. (2)

    def __post_init__(self) -> None:
        if self.method not in ("alternating", "reciprocal"):
            raise InputError("texture.method", self.method, "alternating or reciprocal")


@dataclass(frozen=True, eq=False)
class Difference:
    """The difference measure of one surface (1.1.1)."""

    share: float  # of neighbouring pairs that differ by more than the threshold, the same way in all photographs
    typical: float  # the 98th percentile of their common difference, as a logarithm
    spread: float  # robust relative spread of albedo over the surface

    def is_textured(self, options: TextureOptions) -> bool:
        """Whether neighbours differ often and strongly enough."""
        strong = self.share >= options.min_share and self.typical >= options.min_difference
        return strong or self.spread >= options.min_spread


def difference_measure(
    observed: Observations,
    points: ShadingPoints,
    surface: Int32[np.ndarray, " point"],
    albedo: Float32[np.ndarray, "point 3"],
    camera: Camera,
    num_surfaces: int,
    options: TextureOptions,
) -> list[Difference]:
    """How strongly neighbouring pixels of each surface differ in every photograph alike.

    For a pair of neighbours, the logarithm of the ratio of their radiance over its photographs: the mean is what they
    differ by as materials, the scatter what the light makes of their relief; the mean counts beyond 3 standard errors.
    """
    grid = np.full(camera.num_pixels, -1, np.int64)
    grid[points.pixel] = np.arange(len(points))
    grid = grid.reshape(camera.height, camera.width)
    left = np.concatenate([grid[:, :-2].ravel(), grid[:-2].ravel()])
    right = np.concatenate([grid[:, 2:].ravel(), grid[2:].ravel()])
    alike = (left >= 0) & (right >= 0) & (surface[left] == surface[right])
    alike &= observed.is_interior[left] & observed.is_interior[right]
    left, right = left[alike], right[alike]
    flat = np.einsum("pi,pi->p", points.normal[left], points.normal[right]) > 0.99
    left, right = left[flat], right[flat]
    good = _is_told(observed)
    count, total, square = (np.zeros(len(left)) for _ in range(3))
    for photo in range(len(good)):
        gray = _log(observed.radiance[photo].mean(axis=1))
        form = _log(observed.form[photo].mean(axis=1))
        both = good[photo][left] & good[photo][right]
        ratio = np.where(both, (gray - form)[left] - (gray - form)[right], 0.0)
        count, total, square = count + both, total + ratio, square + ratio**2
    mean = total / np.maximum(count, 1)
    scatter = np.sqrt(np.maximum(square / np.maximum(count, 1) - mean**2, 0) / np.maximum(count - 1, 1))
    common = np.where(count >= 2, np.maximum(np.abs(mean) - 3 * scatter, 0.0), 0.0)
    return [
        _difference(common[(surface[left] == s) & (count >= 2)], albedo[(surface == s) & observed.is_interior], options)
        for s in range(num_surfaces)
    ]


def _is_told(observed: Observations) -> Bool[np.ndarray, "photo point"]:
    """Where a photograph shows an albedo under direct light, and nothing brighter than it."""
    return observed.is_safe & observed.is_lit & ~observed.is_highlight & (observed.weight > 0)


def _log(values: np.ndarray) -> np.ndarray:
    """The logarithm with a floor at a millionth of the largest value: under lamps the values have a unit."""
    return np.log(np.maximum(values, max(1e-6 * float(values.max(initial=0.0)), 1e-30)))


def _difference(common: np.ndarray, albedo: np.ndarray, options: TextureOptions) -> Difference:
    gray = albedo.mean(axis=1)
    gray = gray[gray > 0]
    if len(common) < 20 or len(gray) < 20:
        return Difference(0.0, 0.0, 0.0)
    low, middle, high = np.quantile(gray, (0.16, 0.5, 0.84))
    spread = (high - low) / 2 / max(middle, 1e-9)
    return Difference(float((common > options.min_difference).mean()), float(np.quantile(common, 0.98)), float(spread))


def unlike_share(
    observed: Observations,
    points: ShadingPoints,
    surface: Int32[np.ndarray, " point"],
    is_matte: Bool[np.ndarray, " point"],
    direct: Float32[np.ndarray, "photo point color"],
    camera: Camera,
    num_surfaces: int,
) -> Float64[np.ndarray, " surface"]:
    """The share of each surface that sends back UNLIKE times its median, or that part of it, in some colour.

    Two paints on a wall differ so at few of its pixels' borders. Blocks of pixels are compared by their lowest radiance
    for the direct light, of the photographs that light them well: indirect light adds least there. 0 for a surface of
    fewer than 20 blocks.
    """
    good = _is_told(observed) & observed.is_interior & is_matte
    row, column = np.divmod(points.pixel.astype(np.int64), camera.width)
    place = (row // BLOCK_PX * camera.width + column // BLOCK_PX) * num_surfaces + surface
    keys, block, size = np.unique(place, return_inverse=True, return_counts=True)
    gather = sp.csr_matrix((np.ones(len(place)), (block.ravel(), np.arange(len(place)))), shape=(len(keys), len(place)))
    ratio, light = np.full((2, len(good), len(keys), 3), np.nan)
    for photo, counts in enumerate(good):
        got = gather @ (counts[:, None] * np.broadcast_to(direct[photo], observed.radiance[photo].shape))
        sent = gather @ (counts[:, None] * np.maximum(observed.radiance[photo], 0.0))
        light[photo] = got / size[:, None]
        ratio[photo] = np.where(gather @ counts[:, None] > size[:, None] / 2, sent / np.maximum(got, 1e-30), np.nan)
    is_bright = np.isfinite(ratio) & (light > 0.4 * light.max(axis=0))
    ratio = np.where(is_bright, ratio, np.inf)
    lowest = np.log(np.maximum(ratio.min(axis=0), 1e-30))
    told = np.isfinite(lowest).all(axis=1) & (is_bright.sum(axis=0) >= 2).all(axis=1)
    normal = gather @ points.normal
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    owner, place = keys % num_surfaces, keys // num_surfaces
    share = np.zeros(num_surfaces)
    for s in range(num_surfaces):
        mine = np.flatnonzero(told & (owner == s))
        if len(mine) < 20:
            continue
        away = lowest[mine] - np.median(lowest[mine], axis=0)
        is_unlike = np.abs(away).max(axis=1) > np.log(UNLIKE)
        # A lobe, or light from close by, makes a slope of it; a paint has an edge.
        pairs = np.concatenate([_followers(place[mine], 2), _followers(place[mine], 2 * camera.width)])
        one, other = pairs[is_unlike[pairs[:, 0]] != is_unlike[pairs[:, 1]]].T
        flat = np.einsum("pi,pi->p", normal[mine[one]], normal[mine[other]]) > 0.99
        step = np.abs(away[one] - away[other]).max(axis=1)[flat]
        if len(step) >= 16 and np.median(step) > 0.6 * np.log(UNLIKE):
            share[s] = is_unlike.mean()
    return share


def _followers(place: np.ndarray, step: int) -> np.ndarray:
    """Pairs of indices whose sorted places lie a step apart."""
    found = np.minimum(np.searchsorted(place, place + step), len(place) - 1)
    one = np.flatnonzero(place[found] == place + step)
    return np.stack([one, found[one]], axis=1)


def left_out_gain(
    target: Float32[np.ndarray, "photo point 3"],
    weight: Float32[np.ndarray, "photo point"],
    light: Float32[np.ndarray, "photo point 3"],
    surface: Int32[np.ndarray, " point"],
    num_surfaces: int,
    white: float,
    num_folds: int = 3,
) -> list[tuple[float, float, float]]:
    """What an albedo per pixel gains over one per surface on photographs left out of both: (dB, its scatter over folds,
    its robust scatter over single photographs), the scatters as standard errors.

    The error is on a compressed scale, as a display shows it. A texture gains in every photograph: one that a highlight
    spoils moves the folds' scatter, and not the photographs'. A surface without data gains nothing.
    """
    num_photos = len(target)
    num_folds = min(num_folds, num_photos)
    if num_folds < 2:
        return [(0.0, 0.0, 0.0)] * num_surfaces
    top = np.einsum("lp,lpc,lpc->lpc", weight, light, target, optimize=True) * np.pi
    bottom = np.einsum("lp,lpc,lpc->lpc", weight, light, light, optimize=True)
    errors = np.zeros((2, num_photos, num_surfaces))
    for fold in range(num_folds):
        out = np.arange(fold, num_photos, num_folds)
        inside = np.setdiff1d(np.arange(num_photos), out)
        t, b = top[inside].sum(axis=0), bottom[inside].sum(axis=0)
        mean_t, mean_b = (np.stack([np.bincount(surface, a[:, c], num_surfaces) for c in range(3)], 1) for a in (t, b))
        whole = (mean_t / np.maximum(mean_b, 1e-30))[surface]
        own = np.where(b > 0, t / np.maximum(b, 1e-30), whole)
        for k, albedo in enumerate((whole, own)):
            model = albedo / np.pi * light[out]
            miss = np.arcsinh(model / white) - np.arcsinh(target[out] / white)
            lost = (weight[out][..., None] * np.minimum(miss**2, 0.25)).sum(axis=2)
            errors[k, out] = [np.bincount(surface, of_photo, num_surfaces) for of_photo in lost]
    return [_gain_and_scatters(errors[0, :, s], errors[1, :, s], num_folds) for s in range(num_surfaces)]


def _gain_and_scatters(
    before: Float64[np.ndarray, " photo"], after: Float64[np.ndarray, " photo"], num_folds: int
) -> tuple[float, float, float]:
    """The gain in dB of all photographs together, and its standard errors by folds and by photographs that tell."""
    gain = float(_decibels(before.sum(keepdims=True), after.sum(keepdims=True))[0])
    folds = [np.array([errors[k::num_folds].sum() for k in range(num_folds)]) for errors in (before, after)]
    by_folds = float(_decibels(*folds).std() / num_folds**0.5)
    tells = before > TELLING * before.max(initial=0.0)
    if tells.sum() < 2:
        return gain, by_folds, by_folds
    gains = _decibels(before[tells], after[tells])
    return gain, by_folds, float(robust_scale(gains - np.median(gains)) / len(gains) ** 0.5)


def _decibels(before: Float64[np.ndarray, " photo"], after: Float64[np.ndarray, " photo"]) -> np.ndarray:
    return 10 * np.log10(np.maximum(before, 1e-12) / np.maximum(after, 1e-12))


def by_reciprocals(
    target: Float32[np.ndarray, "photo point 3"],
    weight: Float32[np.ndarray, "photo point"],
    direct: Float32[np.ndarray, "photo point color"],
    face: Int32[np.ndarray, " point"],
    albedo: Float32[np.ndarray, "point 3"],
    max_pixels: int = 64,
) -> Float32[np.ndarray, "point 3"]:
    """The albedo with its texture inside each face by eq. (2): its ratios there, and the face's mean as it was.

    A photograph counts for a face whose pixels all have weight in it. Faces of one pixel, of more than `max_pixels`, and
    those that eq. (2) leaves without a positive answer keep what they have.
    """
    out = albedo.copy()
    order = np.argsort(face, kind="stable")
    faces, first, count = np.unique(face[order], return_index=True, return_counts=True)
    for size in np.unique(count[(count > 1) & (count <= max_pixels)]):
        points = order[first[count == size][:, None] + np.arange(size)]  # face x pixel
        whole = (weight[:, points] > 0).all(axis=2).T[..., None]  # face x photo x 1
        for color in range(3):
            light = direct[:, points, min(color, direct.shape[2] - 1)].transpose(1, 0, 2).astype(np.float64)
            radiance = target[:, points, color].transpose(1, 0, 2).astype(np.float64)
            found = reciprocal_texture(np.where(whole, radiance, 0.0), np.where(whole, light, 0.0))
            value = found.value[..., 0]
            mean = albedo[points, color].mean(axis=1, keepdims=True)
            good = (found.status != Status.NO_DATA) & (value > 0).all(axis=1)
            ratio = value / np.maximum(value.mean(axis=1, keepdims=True), 1e-12)
            out[points[good], color] = (ratio * mean)[good]
    return out


def reciprocal_texture(
    radiance: Float64[np.ndarray, "face photo pixel"], direct: Float64[np.ndarray, "face photo pixel"]
) -> Solution:
    """Albedos of pixels of one colour that share their face's indirect light, eq. (2): linear in 1 / albedo.

    I_i / k_i - I_1 / k_1 = w_i - w_1 over all photographs, I being pi * radiance and w the direct irradiance. `value`
    is (face, pixel, 1) of albedos. Where every right side is zero (a flat face under a distant light, trap 7) only the
    ratios are fixed: the status is RANK_DEFICIENT, the ratios are right, and the largest albedo is 1 until a scale is
    found elsewhere (eq. 1). Pixels equal in every photograph come out equal.
    """
    radiance, direct = np.asarray(radiance, np.float64) * np.pi, np.asarray(direct, np.float64)
    num_faces, num_photos, num_pixels = radiance.shape
    usable = np.isfinite(radiance).all(axis=(1, 2)) & np.isfinite(direct).all(axis=(1, 2))
    usable &= (np.where(np.isfinite(radiance), radiance, 0.0) > 0).any(axis=(1, 2)) & (num_pixels > 1)
    radiance, direct = (np.where(usable[:, None, None], a, 1.0) for a in (radiance, direct))
    # Eliminating the shared indirect light is subtracting each photograph's mean over the pixels.
    center = np.eye(num_pixels) - 1.0 / num_pixels
    matrix = (center * radiance[:, :, None, :]).reshape(num_faces, num_photos * num_pixels, num_pixels)
    side = (direct - direct.mean(axis=2, keepdims=True)).reshape(num_faces, -1, 1)
    size = np.maximum(np.linalg.norm(matrix, axis=(1, 2)), 1e-300)
    u, s, vt = np.linalg.svd(matrix / size[:, None, None], full_matrices=False)
    flat = np.linalg.norm(side, axis=(1, 2)) <= 1e-9 * np.maximum(np.linalg.norm(direct, axis=(1, 2)), 1e-30)
    keep = s > 2 * np.finfo(np.float64).eps * max(matrix.shape[1:]) * s[:, :1]
    steps = np.where(keep, 1 / np.where(keep, s, 1.0), 0.0)[..., None] * (u.transpose(0, 2, 1) @ side)
    reciprocal = (vt.transpose(0, 2, 1) @ steps)[..., 0] / size[:, None]
    # Homogeneous: the reciprocals are the null vector, known up to a scale.
    reciprocal = np.where(flat[:, None], np.abs(vt[:, -1]), reciprocal)
    floor = np.where(flat, 1e-12 * np.abs(vt[:, -1]).max(axis=1), 1e-12)[:, None]
    albedo = np.where(reciprocal > 0, 1.0 / np.maximum(reciprocal, floor), 0.0)
    albedo = np.where(flat[:, None], albedo / np.maximum(albedo.max(axis=1, keepdims=True), 1e-300), albedo)
    rank = np.where(flat, num_pixels - 1, keep.sum(axis=1)).astype(np.int32)
    is_full = ~flat & (rank == num_pixels)
    condition = np.where(is_full, s[:, 0] / np.where(is_full, s[:, -1], 1.0), np.inf)
    miss = np.sqrt(np.mean((matrix @ reciprocal[..., None] - side) ** 2, axis=(1, 2)))
    status = np.where(is_full & (reciprocal > 0).all(axis=1), Status.OK, Status.RANK_DEFICIENT)
    return Solution(
        np.where(usable[:, None], albedo, 0.0)[..., None],
        np.where(usable, status, Status.NO_DATA).astype(np.int8),
        np.where(usable, rank, 0).astype(np.int32),
        np.where(usable, condition, np.inf),
        np.where(usable, np.where(flat, s[:, -1], miss), 0.0),
    )
