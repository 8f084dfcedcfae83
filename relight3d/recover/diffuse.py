"""Diffuse reflectance from shadow borders: section 1.2.1 and eq. (1), Wu et al. 2004.

Across the border of a cast shadow only the direct light changes, so the difference of two nearby pixels of one surface
is albedo / pi times the difference of their direct irradiance: least squares over all borders of all photographs. A
surface that no shadow border crosses has no such equation; there reflectance and indirect light are solved together
(`joint_albedo`), which works as far as its direct light is not itself a low-order function of the light (trap 2).

Differs from the paper: robust (Huber from a weighted median), since real borders are displaced; only pairs whose two
sides both face the light, since pairs across attached shadows and creases came out 40-50 % low (trap 1).
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float32, Float64, Int32
from scipy.sparse.csgraph import connected_components

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.maths.least_squares import Solution, Status, robust_scale, robust_weights, weighted_median
from relight3d.maths.topology import face_adjacency
from relight3d.records import Observations, PatchMesh, ShadingPoints

POOLED = 16  # neighbouring pixels whose sums bound an albedo together
LEAST_DIRECT = 0.01  # of the radiance where a lamp shines


@dataclass(frozen=True)
class DiffuseOptions:
    """Which pairs speak for the reflectance, and when they are believed."""

    pair_px: tuple[int, ...] = (4, 6, 9)  # distances between the two pixels of a pair
    max_normal_deg: float = 12.0  # between the two normals
    min_contrast: float = 0.15  # of the direct form across the border, relative to the photograph's largest
    min_pairs: int = 40  # fewer pairs than this do not decide a surface
    max_scatter: float = 0.5  # nor do ratios that scatter by more than this part of their median

    def __post_init__(self) -> None:
        if not self.pair_px or min(self.pair_px) < 2:
            raise InputError("diffuse.pair_px", self.pair_px, "distances of 2 pixels or more")


def border_pairs(
    observed: Observations,
    points: ShadingPoints,
    surface: Int32[np.ndarray, " point"],
    camera: Camera,
    options: DiffuseOptions,
) -> Int32[np.ndarray, "pair 3"]:
    """(photograph, lit point, shadowed point) of every usable pair across a cast shadow, as point indices."""
    grid = np.full(camera.num_pixels, -1, np.int32)
    grid[points.pixel] = np.arange(len(points), dtype=np.int32)
    grid = grid.reshape(camera.height, camera.width)
    pairs = []
    for step in options.pair_px:
        for left, right in (
            (grid[:, : -step or None], grid[:, step:]),
            (grid[: -step or None], grid[step:]),
        ):
            a, b = left.ravel(), right.ravel()
            both = (a >= 0) & (b >= 0)
            a, b = a[both], b[both]
            alike = surface[a] == surface[b]
            alike &= np.einsum("ni,ni->n", points.normal[a], points.normal[b]) > np.cos(
                np.radians(options.max_normal_deg)
            )
            pairs.append((a[alike], b[alike]))
    found = []
    good = observed.is_safe & observed.is_facing & ~observed.is_highlight & (observed.weight > 0)
    for photo in range(len(good)):
        lit, ok = observed.is_lit[photo], good[photo]
        contrast = observed.form[photo].mean(axis=1)
        limit = options.min_contrast * (contrast.max() if len(contrast) else 0.0)
        for a, b in pairs:
            crosses = ok[a] & ok[b] & (lit[a] != lit[b]) & (np.abs(contrast[a] - contrast[b]) > limit)
            a_, b_ = a[crosses], b[crosses]
            bright = np.where(lit[a_], a_, b_)
            dark = np.where(lit[a_], b_, a_)
            found.append(np.stack([np.full(len(bright), photo, np.int32), bright, dark], axis=1))
    return np.concatenate(found).astype(np.int32) if found else np.zeros((0, 3), np.int32)


def panels_of(mesh: PatchMesh, surface_of_face: Int32[np.ndarray, " face"], crease_deg: float = 25.0) -> np.ndarray:
    """The smooth pieces of each surface, per face: a box's six sides. Where an albedo is kept per pixel its scale is found
    per piece, since what two pieces differ by may be their indirect light as well as their texture.
    """
    faces = mesh.welded_vertex[mesh.faces].astype(np.int64)
    pairs = face_adjacency(faces.astype(np.int32))
    a, b = pairs[:, 0], pairs[:, 1]
    smooth = np.einsum("ni,ni->n", mesh.face_normals[a], mesh.face_normals[b]) > np.cos(np.radians(crease_deg))
    smooth &= surface_of_face[a] == surface_of_face[b]
    num = len(faces)
    graph = sp.csr_matrix((np.ones(int(smooth.sum())), (a[smooth], b[smooth])), shape=(num, num))
    return connected_components(graph, directed=False)[1].astype(np.int32)


def border_albedo(
    pairs: Int32[np.ndarray, "pair 3"],
    observed: Observations,
    target: Float32[np.ndarray, "photo point 3"],
    direct: Float32[np.ndarray, "photo point color"],
    texture: Float32[np.ndarray, "point 3"],
    surface: Int32[np.ndarray, " point"],
    num_surfaces: int,
    options: DiffuseOptions,
) -> Solution:
    """Albedo scale of each surface by eq. (1), robustly; `value` is (surface, 1, colour).

    `texture` is each point's albedo relative to its surface (ones for an untextured one). Status NO_DATA where too few
    pairs cross a border, RANK_DEFICIENT where they scatter too much to decide.
    """
    photo, bright, dark = pairs.T
    difference = (direct[photo, bright] - direct[photo, dark]) / np.pi
    ratio_of = np.maximum(texture, 1e-4)
    change = target[photo, bright] / ratio_of[bright] - target[photo, dark] / ratio_of[dark]
    value = np.zeros((num_surfaces, 1, 3))
    status = np.full(num_surfaces, Status.NO_DATA, np.int8)
    scatter = np.zeros(num_surfaces)
    for index in np.unique(surface[bright]) if len(pairs) else ():
        mine = surface[bright] == index
        if mine.sum() < options.min_pairs:
            continue
        steps, rises = np.broadcast_to(difference[mine], change[mine].shape), change[mine]
        weight = observed.weight[photo[mine], bright[mine]]
        fits = [_robust_ratio(steps[:, c], rises[:, c], weight) for c in range(3)]
        value[index, 0] = [max(f[0], 0.0) for f in fits]
        scatter[index] = np.mean([f[1] for f in fits])
        good = scatter[index] <= options.max_scatter * max(value[index].mean(), 1e-6) and value[index].max() > 0
        status[index] = Status.OK if good else Status.RANK_DEFICIENT
    rank = (status == Status.OK).astype(np.int32)
    return Solution(value, status, rank, np.where(rank > 0, 1.0, np.inf), scatter)


def _robust_ratio(steps: np.ndarray, rises: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """rises = ratio * steps by Huber's weights from a weighted median, and the scatter of the ratios."""
    # Relative: with lamps for lights, a step of the form has the unit 1 / length^2.
    usable = steps > 1e-6 * np.max(steps, initial=0.0)
    if not usable.any():
        return 0.0, 0.0
    ratios, power = rises[usable] / steps[usable], weight[usable] * steps[usable] ** 2
    ratio = weighted_median(ratios, power)
    for _ in range(10):
        spread = float(robust_scale(ratios - ratio))
        w = power * robust_weights(ratios - ratio, max(spread, 1e-9))
        ratio = float((w * ratios).sum() / max(w.sum(), 1e-30))
    return ratio, float(robust_scale(ratios - ratio))


def pixel_albedo(
    observed: Observations,
    target: Float32[np.ndarray, "photo point 3"],
    weight: Float32[np.ndarray, "photo point"],
    direct: Float32[np.ndarray, "photo point color"],
    indirect: Float32[np.ndarray, "photo point 3"] | None,
) -> tuple[Float32[np.ndarray, "point 3"], Float32[np.ndarray, "point 3"]]:
    """Each point's albedo by least squares over the photographs, and the information (summed squares) behind it.

    radiance = albedo / pi * (direct + indirect): one unknown, so nothing can be ill-conditioned, only empty; a point
    without information gets 0 and says so by its information.
    """
    top = np.zeros(target.shape[1:], np.float64)
    bottom = np.zeros_like(top)
    for photo in range(len(target)):
        light = direct[photo] if indirect is None else direct[photo] + indirect[photo]
        light = np.broadcast_to(light, top.shape) / np.float32(np.pi)
        weighted = weight[photo][:, None] * light
        top += weighted * target[photo]
        bottom += weighted * light
    albedo = np.where(bottom > 0, top / np.maximum(bottom, 1e-30), 0.0)
    return np.clip(albedo, 0.0, None).astype(np.float32), bottom.astype(np.float32)


def joint_albedo(
    binding: sp.csr_matrix,
    site_surface: Int32[np.ndarray, " site"],
    num_surfaces: int,
    texture: Float32[np.ndarray, "point 3"],
    target: Float32[np.ndarray, "photo point 3"],
    weight: Float32[np.ndarray, "photo point"],
    direct: Float32[np.ndarray, "photo point color"],
    rows: Float64[np.ndarray, "photo unknown"],
) -> Solution:
    """Albedo scale of each surface together with the indirect light of its sites (trap 2).

    Per site, the direct light's part that the low-order functions `rows` cannot imitate carries the reflectance: both
    are projected off the functions, and what is left is a ratio. A surface's value is the median of its sites by
    information. `condition` is the direct light's length over its unexplained part: 1e2 and more is a guess.
    """
    num_photos, unknowns = rows.shape
    sums = np.zeros((3, 3, binding.shape[0], num_photos))  # (w t^2, w t y, w t^2 d) per colour
    for photo in range(num_photos):
        base = weight[photo][:, None] * texture
        light = np.broadcast_to(direct[photo], texture.shape)
        columns = np.concatenate([base * texture, base * target[photo] * np.float32(np.pi), base * texture * light], 1)
        sums[:, :, :, photo] = (binding @ columns).T.reshape(3, 3, -1)
    value = np.zeros((num_surfaces, 1, 3))
    condition = np.full(num_surfaces, np.inf)
    info_total = np.zeros(num_surfaces)
    outer = (rows[:, :, None] * rows[:, None, :]).reshape(num_photos, -1)
    for color in range(3):
        w, y, d = sums[0, color], sums[1, color], sums[2, color]
        safe = np.maximum(w, 1e-30)
        gram = (w @ outer).reshape(-1, unknowns, unknowns)
        ridge = 1e-6 * np.maximum(np.einsum("nuu->n", gram), 1e-30)
        inverse = np.linalg.inv(gram + ridge[:, None, None] * np.eye(unknowns))
        coefficient = np.einsum("nuv,nv->nu", inverse, d @ rows)
        left = d - w * (coefficient @ rows.T)  # w * unexplained direct light
        info = np.where(w > 0, left**2 / safe, 0.0).sum(axis=1)
        full = np.where(w > 0, d**2 / safe, 0.0).sum(axis=1)
        score = np.where(w > 0, left * y / safe, 0.0).sum(axis=1)
        told = info > 1e-4 * np.maximum(full, 1e-30)
        ratio = np.where(told, score / np.maximum(info, 1e-30), 0.0)
        for index in range(num_surfaces):
            mine = told & (site_surface == index)
            value[index, 0, color] = max(weighted_median(ratio[mine], info[mine]), 0.0)
            info_total[index] += info[mine].sum()
            share = info[mine].sum() / max(full[site_surface == index].sum(), 1e-30)
            condition[index] = min(condition[index], 1 / np.sqrt(share) if share > 0 else np.inf)
    weak = (condition > 30) | ~(value.max(axis=(1, 2)) > 0)
    status = np.where(info_total <= 0, Status.NO_DATA, np.where(weak, Status.RANK_DEFICIENT, Status.OK)).astype(np.int8)
    return Solution(value, status, (status == Status.OK).astype(np.int32), condition, np.zeros(num_surfaces))


def upper_bound(
    observed: Observations,
    target: Float32[np.ndarray, "photo point 3"],
    weight: Float32[np.ndarray, "photo point"],
    direct: Float32[np.ndarray, "photo point color"],
    texture: Float32[np.ndarray, "point 3"],
    surface: Int32[np.ndarray, " point"],
    num_surfaces: int,
) -> Float64[np.ndarray, "surface 3"]:
    """What each surface's albedo cannot exceed, since indirect light is not negative: inf for a surface never lit.

    radiance * pi / direct = albedo * (1 + indirect / direct) >= albedo in every photograph, so the smallest ratio bounds
    it; the lowest sixth is taken for the smallest (of four and more, one at least passes: somebody's shadow), and the
    median over pools of points, so that noise does not.
    """
    bound = np.full((num_surfaces, 3), np.inf)
    if (ambient := observed.ambient) is not None:  # it is known, and taken off
        target = target - ambient
    for s in range(num_surfaces):
        mine = np.flatnonzero((surface == s) & observed.is_interior)
        if len(mine) < 5:
            continue
        # Pixels side by side are pooled: of single ones noise would make the lowest sixth too low, by its deviation.
        pool = min(POOLED, len(mine) // 5)
        mine = mine[: len(mine) // pool * pool].reshape(-1, pool)[:: max(1, len(mine) // 16_000)].ravel()
        light = np.broadcast_to(direct[:, mine], (len(direct), len(mine), 3))
        bright = (weight[:, mine, None] > 0) & observed.is_lit[:, mine, None] & (light > 0.4 * light.max(axis=0))
        pools = (len(direct), -1, pool, 3)
        sent, got, bright = (
            np.where(bright, x, 0.0).reshape(pools) for x in (target[:, mine], light * texture[mine], 1.0)
        )
        is_told = bright.mean(axis=2) > 0.5
        ratio = np.where(is_told, np.pi * sent.sum(axis=2) / np.maximum(got.sum(axis=2), 1e-30), np.inf)
        count = is_told.sum(axis=0)
        low = np.take_along_axis(np.sort(ratio, axis=0), np.maximum(count // 6, count > 3)[None], axis=0)[0]
        for c in range(3):
            told = (count[:, c] >= 2) & np.isfinite(low[:, c])
            if told.sum() >= 5:
                bound[s, c] = max(float(np.median(low[told, c])), 0.0)
    return bound


def surface_scale(
    border: Solution, joint: Solution, plain: Float64[np.ndarray, "surface 3"], bound: Float64[np.ndarray, "surface 3"]
) -> tuple[Float64[np.ndarray, "surface 3"], Bool[np.ndarray, " surface"], tuple[str, ...]]:
    """Each surface's albedo scale: by its borders, else jointly, else by the prior that indirect light is small there;
    the last two never above what indirect light >= 0 allows.

    Returns the scale, whether it is pinned (decided by data, not by the prior), and a word for each.
    """
    by_border, by_joint = border.status == Status.OK, joint.status == Status.OK
    value = np.where(by_border[:, None], border.value[:, 0], np.where(by_joint[:, None], joint.value[:, 0], plain))
    words = tuple("border" if b else "joint" if j else "prior" for b, j in zip(by_border, by_joint, strict=True))
    value = np.where(by_border[:, None], value, np.minimum(value, bound))
    # What lit photographs show is direct light at least to this part: of an albedo of 0, indirect light would be endless.
    value = np.maximum(value, LEAST_DIRECT * plain)
    return value, by_border | by_joint, words
