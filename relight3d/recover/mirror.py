"""Mirrors: section 1.1.3, Wu et al. 2004. Assume a surface is one, predict the edges it would show, look for them.

The prediction needs no material: where the reflected rays of neighbouring pixels meet different surfaces, or the same
one across a crease or a jump in depth, a mirror shows an edge. The edges found are Sobel's, on compressed radiance,
averaged over the photographs so that shadows, which move, fade and edges, which stay, remain. The surface is a mirror
when the two correlate, and correlate better than when the prediction is shifted. Where they do so faintly (few or small
things to be seen in it), what it would reflect of the scene as first fitted must explain what it shows.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32
from scipy import ndimage
from skimage.filters import sobel

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.maths.least_squares import robust_scale, robust_weights
from relight3d.records import Mirror, PatchMesh, ShadingPoints
from relight3d.shading import points_mirrored
from relight3d.tracing import RayScene


@dataclass(frozen=True)
class MirrorOptions:
    """When a surface is believed to be a mirror."""

    min_score: float = 0.15  # correlation of predicted and found edges, for a surface to be tried as a mirror
    min_lead: float = 0.04  # over the best shifted prediction, which stands for chance
    sure_score: float = 0.3  # a mirror, whatever it may show beside the mesh
    sure_lead: float = 0.12
    min_explained: float = 0.7  # of what varies, by the reflection: for a mirror whose edges are not sure
    min_pixels: int = 150  # a smaller surface shows too few edges
    max_bend_deg: float = 25.0  # between normals of one gently curved mirror
    plane_deg: float = 1.0  # scatter of normals below which it is a plane

    def __post_init__(self) -> None:
        if not 0 < self.min_score < 1:
            raise InputError("mirror.min_score", self.min_score, "a correlation between 0 and 1")


@dataclass(frozen=True, eq=False)
class EdgeTest:
    """What the edge test of one surface saw, for the verdict and for a person to look at."""

    surface: int
    score: float
    chance: float  # the best correlation of a shifted prediction
    predicted: Bool[np.ndarray, "height width"]
    found: Float32[np.ndarray, "height width"]

    def passes(self, options: MirrorOptions) -> bool:
        """Whether the surface is tried as a mirror."""
        return self.score >= options.min_score and self.score - self.chance >= options.min_lead

    def is_sure(self, options: MirrorOptions) -> bool:
        """Whether the edges alone make it one."""
        return self.score >= options.sure_score and self.score - self.chance >= options.sure_lead


def doubtful(mirrors: tuple[Mirror, ...], tests: list[EdgeTest], options: MirrorOptions) -> set[int]:
    """The surfaces of those mirrors whose edges alone do not make them mirrors."""
    return {t.surface for t in tests if not t.is_sure(options)} & {m.surface for m in mirrors}


def edge_test(
    scene: RayScene,
    mesh: PatchMesh,
    points: ShadingPoints,
    surface: Int32[np.ndarray, " point"],
    surface_of_face: Int32[np.ndarray, " face"],
    camera: Camera,
    radiance: Float32[np.ndarray, "photo point 3"],
    index: int,
    options: MirrorOptions,
) -> EdgeTest | None:
    """The edge test of one surface; None where it is too small or too bent to be a mirror that shows a picture."""
    mine = np.flatnonzero(surface == index)
    if len(mine) < options.min_pixels:
        return None
    normal = points.normal[mine]
    mean = normal.mean(axis=0)
    mean /= max(np.linalg.norm(mean), 1e-9)
    if np.degrees(np.arccos(np.clip(np.quantile(normal @ mean, 0.05), -1, 1))) > options.max_bend_deg:
        return None
    inside = _image(camera, points.pixel[mine], True, False)
    core = ndimage.binary_erosion(inside, iterations=2)
    if core.sum() < options.min_pixels // 2:
        return None
    predicted = _predicted_edges(scene, mesh, points.take(mine), surface_of_face, camera)
    found = _found_edges(points, camera, radiance, inside)
    blurred = ndimage.gaussian_filter(predicted.astype(np.float32), 1.0)
    score = _correlation(blurred[core], found[core])
    shifts = [(dy, dx) for dy in (-9, 0, 9) for dx in (-9, 0, 9) if (dy, dx) != (0, 0)]
    chance = max(_correlation(np.roll(blurred, s, axis=(0, 1))[core], found[core]) for s in shifts)
    return EdgeTest(index, score, chance, predicted & inside, found)


def _predicted_edges(
    scene: RayScene, mesh: PatchMesh, points: ShadingPoints, surface_of_face: np.ndarray, camera: Camera
) -> Bool[np.ndarray, "height width"]:
    shown = points_mirrored(scene, mesh, points)
    label = _image(camera, shown.pixel, surface_of_face[shown.face] + 1, 0)
    depth = _image(camera, shown.pixel, shown.depth, 0.0)
    normal = _image(camera, shown.pixel, shown.normal, 0.0)
    edges = np.zeros(label.shape, bool)
    for axis in (0, 1):
        ahead = [np.roll(a, -1, axis) for a in (label, depth, normal)]
        differs = label != ahead[0]
        differs |= np.abs(depth - ahead[1]) > 0.08 * np.maximum(np.maximum(depth, ahead[1]), 1e-9)
        differs |= (np.einsum("yxi,yxi->yx", normal, ahead[2]) < 0.8) & (label > 0) & (ahead[0] > 0)
        edges |= differs
    return edges


def _found_edges(
    points: ShadingPoints, camera: Camera, radiance: Float32[np.ndarray, "photo point 3"], inside: np.ndarray
) -> Float32[np.ndarray, "height width"]:
    """Sobel edges of compressed radiance, the lower half of the photographs averaged: what stays in most of them."""
    layers = []
    for photo in radiance[:: max(1, len(radiance) // 12)]:
        gray = photo.mean(axis=1)
        white = max(float(np.quantile(gray, 0.95)), 1e-9)
        layers.append(sobel(_image(camera, points.pixel, np.arcsinh(8 * np.maximum(gray, 0) / white), 0.0)))
    stack = np.sort(np.stack(layers), axis=0)
    return np.where(inside, stack[: max(1, (len(stack) + 1) // 2)].mean(axis=0), 0.0).astype(np.float32)


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    a, b = a - a.mean(), b - b.mean()
    lengths = np.sqrt((a * a).sum() * (b * b).sum())
    return float((a * b).sum() / lengths) if lengths > 0 else 0.0


def _image(camera: Camera, pixel: np.ndarray, values: np.ndarray | bool, empty: object) -> np.ndarray:
    values = np.asarray(values)
    values = np.broadcast_to(values, pixel.shape) if values.ndim == 0 else values
    out = np.full((camera.num_pixels, *values.shape[1:]), empty, dtype=values.dtype)
    out[pixel] = values
    return out.reshape(camera.height, camera.width, *values.shape[1:])


def mirror_of(
    mesh: PatchMesh,
    surface_of_face: Int32[np.ndarray, " face"],
    index: int,
    points: ShadingPoints,
    score: float,
    options: MirrorOptions,
    reflectance: Float[np.ndarray, "3"] | None = None,
) -> Mirror:
    """The mirror's plane by its faces' area, its disc, and whether it throws light (a plane does)."""
    faces = np.flatnonzero(surface_of_face == index)
    normals, areas = mesh.face_normals[faces].astype(np.float64), mesh.face_areas[faces]
    seen = points.normal.mean(axis=0)
    # A thin board is one surface with two sides and four edges: its mirror is the side that is seen.
    front = normals @ seen > 0.7
    faces, normals, areas = faces[front], normals[front], areas[front]
    normal = (normals * areas[:, None]).sum(axis=0)
    normal /= max(np.linalg.norm(normal), 1e-12)
    corners = mesh.centered_vertices[mesh.faces[faces]].astype(np.float64)
    point = (corners.mean(axis=1) * areas[:, None]).sum(axis=0) / max(areas.sum(), 1e-30)
    spread = np.degrees(np.arccos(np.clip(normals @ normal, -1, 1)))
    is_plane = bool((spread * areas).sum() / max(areas.sum(), 1e-30) < options.plane_deg)
    radius = float(np.linalg.norm(corners.reshape(-1, 3) - point, axis=1).max())
    value = np.full(3, 0.5) if reflectance is None else np.asarray(reflectance, np.float64)
    return Mirror(index, point, normal, value, is_plane, radius, is_plane, score)


def fit_reflectance(
    shown: Float32[np.ndarray, "photo point 3"],
    measured: Float32[np.ndarray, "photo point 3"],
    weight: Float32[np.ndarray, "photo point"],
) -> tuple[Float[np.ndarray, "3"], float]:
    """Reflectance per colour, robustly, and the share of the measured variance that the reflection explains.

    measured = reflectance * shown, by Huber's weights on the compressed scale: the borders of the reflected shadows
    and highlights are displaced and must not decide.
    """
    value = np.zeros(3)
    explained = []
    for color in range(3):
        x, y = shown[..., color].ravel().astype(np.float64), measured[..., color].ravel().astype(np.float64)
        w = weight.ravel() / (x * x + np.quantile(x, 0.5) ** 2 + 1e-12)
        ratio = float((w * x * y).sum() / max((w * x * x).sum(), 1e-30))
        for _ in range(15):
            miss = (y - ratio * x) * np.sqrt(w)
            robust = w * robust_weights(miss, max(float(robust_scale(miss[w > 0])) if (w > 0).any() else 0.0, 1e-9))
            ratio = float((robust * x * y).sum() / max((robust * x * x).sum(), 1e-30))
        value[color] = np.clip(ratio, 0.0, 1.0)
        center = (robust * y).sum() / max(robust.sum(), 1e-30)
        spread = (robust * (y - center) ** 2).sum()
        explained.append(1.0 - (robust * (y - ratio * x) ** 2).sum() / max(spread, 1e-30))
    return value, float(np.mean(explained))
