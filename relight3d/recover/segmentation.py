"""From pixels to parts of one material: patches of like colour, put together again as far as they are alike.

A part may be plain or a print. Plain neighbours join by colour; the colours of a print come out as parts of their own
and are joined because they lie within each other. Plane facets are held together by geometry, one may be a mirror.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64, Int, Int32
from scipy.ndimage import distance_transform_edt
from skimage.segmentation import slic

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.maths import regions
from relight3d.records import ShadingPoints


@dataclass(frozen=True)
class SegmentationOptions:
    """What is alike, what is flat, what is too small."""

    luminance_scatter: float = 0.22  # of the log albedo within one material: indirect light is still in it
    chroma_scatter: float = 0.08  # of the log ratios of its colours
    same_material: float = 0.7  # Bhattacharyya distance below which two parts are one material
    gradual: float = 0.6  # of two parts' difference: less than this share of it at their border is shading
    interleaving: float = 4.5  # colours within each other more than so many discs on a ground are one print
    patch_px: int = 150  # pixels of a patch; less in a picture of fewer than a hundred such
    min_pixels: int = 24  # a smaller part is absorbed
    min_share: float = 0.02  # of its panel: so is a smaller part, if it has less than four patches
    flat_deg: float = 12.0  # a panel whose normals stay within this is not cut: it may be a mirror, a bent one too
    facet_deg: float = 5.0  # nor is a plane facet of a smooth panel, eight patches or larger, with noise of this

    def __post_init__(self) -> None:
        for name in ("luminance_scatter", "chroma_scatter", "same_material", "interleaving"):
            if not 0 < getattr(self, name) < 100:
                raise InputError(f"surfaces.parts.{name}", getattr(self, name), "a number between 0 and 100")
        if not 0 <= self.gradual < 1:
            raise InputError("surfaces.parts.gradual", self.gradual, "a share, 0 to below 1")
        if not 16 <= self.patch_px <= 100_000:
            raise InputError("surfaces.parts.patch_px", self.patch_px, "16 to 100000 pixels")
        if not 1 <= self.min_pixels <= 100_000:
            raise InputError("surfaces.parts.min_pixels", self.min_pixels, "1 to 100000 pixels")
        if not 0 <= self.min_share < 0.5:
            raise InputError("surfaces.parts.min_share", self.min_share, "a share between 0 and 0.5")
        for name in ("flat_deg", "facet_deg"):
            if not 0 < getattr(self, name) < 90:
                raise InputError(f"surfaces.parts.{name}", getattr(self, name), "an angle between 0 and 90 degrees")

    def for_picture(self, num_points: int) -> "SegmentationOptions":
        """The options with patches small enough for a picture of so many points to have a hundred of them."""
        return replace(self, patch_px=max(16, min(self.patch_px, num_points // 100)))

    @property
    def floor(self) -> Float64[np.ndarray, "3"]:
        """The scatter of log luminance and of the two log colour ratios that one material may have."""
        return np.array([self.luminance_scatter, self.chroma_scatter, self.chroma_scatter])


@dataclass(frozen=True, eq=False)
class Parts:
    """Patches and the parts they are put together to; only parts of one panel may become one."""

    patches: regions.Moments  # of their colours
    panel: Int32[np.ndarray, " patch"]
    pairs: Int32[np.ndarray, "pair 2"]  # of patches that touch
    border: Float64[np.ndarray, " pair"]  # and by how many pixels
    label: Int32[np.ndarray, " patch"]  # the part of each patch

    def joined(self, into: Int32[np.ndarray, " part"]) -> "Parts":
        """Parts put together further."""
        return replace(self, label=into[self.label])

    def moments(self) -> regions.Moments:
        """Of the colours of each part, with the scatter within its patches: shading across a part is none of it."""
        return regions.united(self.patches, self.label, grows=False)

    @property
    def panel_of_part(self) -> Int32[np.ndarray, " part"]:
        """The panel of its largest patch: small patches may have come from another."""
        order = np.argsort(self.patches.count, kind="stable")
        panel = np.zeros(int(self.label.max()) + 1, np.int32)
        panel[self.label[order]] = self.panel[order]
        return panel

    def touching(
        self, across_panels: bool = False
    ) -> tuple[Int32[np.ndarray, "border 2"], Float64[np.ndarray, " border"]]:
        """Pairs of parts that touch, those of one panel or all, and by how many pixels."""
        pairs, border = regions.borders(self.label[self.pairs], self.border)
        panel = self.panel_of_part
        kept = across_panels | (panel[pairs[:, 0]] == panel[pairs[:, 1]])
        return pairs[kept], border[kept]


def cut_panels(
    points: ShadingPoints,
    camera: Camera,
    panel: Int[np.ndarray, " point"],
    colors: Float64[np.ndarray, "point 3"],
    near: Int32[np.ndarray, "pair 2"],
    options: SegmentationOptions,
) -> tuple[Int32[np.ndarray, " point"], Int32[np.ndarray, " point"]]:
    """The panel and the part of each point: panels with their facets as panels of their own, and parts of one material.

    `panel` are the pieces that geometry gives, `colors` log luminance and two log colour ratios, `near` the points that
    are neighbours. At least one point.
    """
    panel = regions.renumbered(panel)
    size = np.bincount(panel)
    is_whole = is_flat(points, panel, options.flat_deg) | (size < 4 * options.patch_px)
    patch = _number(panel, np.where(is_whole[panel], 0, 1 + color_patches(points, camera, colors, options)))
    near = near[panel[near[:, 0]] == panel[near[:, 1]]]
    facet = flat_facets(points, patch, near, options)
    facet = np.where(is_whole[panel], -1, facet)
    panel, patch = _number(panel, facet), _number(panel, facet, np.where(facet < 0, patch, 0))
    parts = join_alike(parts_of(colors, panel, patch, near, options), options)
    return parts.panel_of_part[parts.label][patch], parts.label[patch]


def parts_of(
    colors: Float64[np.ndarray, "point 3"],
    panel: Int32[np.ndarray, " point"],
    patch: Int32[np.ndarray, " point"],
    near: Int32[np.ndarray, "pair 2"],
    options: SegmentationOptions,
) -> Parts:
    """Every patch a part of its own; highlights and specks are clipped to their patch's colours."""
    num_patches = int(patch.max()) + 1
    calm = regions.clip_tails(colors, patch, num_patches, 0.1, options.floor / 2)
    pairs, border = regions.borders(patch[near], np.ones(len(near)))
    moments = regions.region_moments(calm, patch, num_patches)
    return Parts(moments, panel[regions.first_of_each(patch)], pairs, border, np.arange(num_patches, dtype=np.int32))


def join_alike(parts: Parts, options: SegmentationOptions) -> Parts:
    """Put patches together: what touches and is alike, like parts of a panel, the colours of a print, small parts."""
    floor, limit = options.floor, options.same_material
    parts = parts.joined(regions.merge_alike(parts.moments(), parts.touching()[0], floor, limit, grows=False))
    parts = join_gradual(parts, options)
    within = regions.pairs_within(parts.panel_of_part)
    parts = parts.joined(regions.merge_alike(parts.moments(), within, floor, limit, grows=False))
    pairs, border = parts.touching()
    parts = parts.joined(regions.merge_interleaved(parts.moments().count, pairs, border, options.interleaving))
    size = np.bincount(parts.panel, parts.patches.count)[parts.panel_of_part]
    is_small = parts.moments().count < np.clip(options.min_share * size, options.min_pixels, 4 * options.patch_px)
    return parts.joined(regions.absorb(parts.moments(), parts.touching(across_panels=True)[0], floor, is_small))


def join_gradual(parts: Parts, options: SegmentationOptions) -> Parts:
    """Join parts whose colours differ, but not at their border: shading, or a soft pattern.

    At the border of two materials nearly all of the difference lies between the patches on its two sides. One pair at a
    time, since a part that is a little of both would otherwise join the two.
    """
    while True:
        pairs, share, step = _steps(parts, options)
        # A step that would tell two materials apart is one, however much the rest of the parts differs.
        share = np.where(step**2 < 8 * options.same_material, share, np.inf)
        if share.min(initial=np.inf) >= options.gradual:
            return parts
        into = np.arange(int(parts.label.max()) + 1)
        one, other = pairs[np.argmin(share)]
        into[other] = one
        parts = parts.joined(regions.renumbered(into))


def _steps(
    parts: Parts, options: SegmentationOptions
) -> tuple[Int32[np.ndarray, "border 2"], Float64[np.ndarray, " border"], Float64[np.ndarray, " border"]]:
    """Touching parts of a panel, and how much of their difference lies at the border: as a share, and in scatters."""
    ends, mean = parts.label[parts.pairs], parts.moments().mean / options.floor
    gap = mean[ends[:, 1]] - mean[ends[:, 0]]
    step = (parts.patches.mean[parts.pairs[:, 1]] - parts.patches.mean[parts.pairs[:, 0]]) / options.floor
    share = (step * gap).sum(axis=1) / np.maximum((gap * gap).sum(axis=1), 1e-12)
    pairs, at_border = regions.borders(ends, parts.border * share)
    _, border = regions.borders(ends, parts.border)
    panel = parts.panel_of_part
    inside = panel[pairs[:, 0]] == panel[pairs[:, 1]]
    pairs, share = pairs[inside], (at_border / border)[inside]
    return pairs, share, share * np.linalg.norm(mean[pairs[:, 1]] - mean[pairs[:, 0]], axis=1)


def flat_facets(
    points: ShadingPoints,
    patch: Int32[np.ndarray, " point"],
    near: Int32[np.ndarray, "pair 2"],
    options: SegmentationOptions,
) -> Int32[np.ndarray, " point"]:
    """Large plane facets of panels whose edges are rounded, as a scan's are; -1 for the points of none.

    They are held together as panels between creases are: a scanned mirror must not be cut by what it shows.
    """
    both = np.concatenate([points.normal, points.position], axis=1).astype(np.float64)
    patches = regions.region_moments(both, patch, int(patch.max()) + 1)
    sine = np.sin(np.radians(options.facet_deg))
    means = replace(patches, covariance=np.zeros_like(patches.covariance))
    normals = regions.Moments(means.count, means.mean[:, :3], means.covariance[:, :3, :3])
    pairs, _ = regions.borders(patch[near], np.ones(len(near)))
    pairs = pairs[(_bend(patches.covariance) < 2 * sine)[pairs].all(axis=1)]
    # Of one plane are patches beside each other, not above each other as a box's lid and the table are.
    way = patches.mean[pairs[:, 0], 3:] - patches.mean[pairs[:, 1], 3:]
    normal = (normals.mean[pairs[:, 0]] + normals.mean[pairs[:, 1]]) / 2
    rise = np.abs(np.einsum("pi,pi->p", way, normal))
    pairs = pairs[rise < 2 * sine * np.linalg.norm(way, axis=1)]
    label = regions.merge_alike(normals, pairs, np.full(3, sine), options.same_material, grows=False)
    between = regions.united(means, label, grows=True)
    is_plane = _bend(between.covariance) < sine / 2
    is_large = between.count >= 8 * options.patch_px
    facet = np.where((is_plane & is_large)[label], label, -1)[patch].astype(np.int32)
    return _grown(facet, points, near, 5 * options.facet_deg)


def _bend(covariance: Float64[np.ndarray, "region 6 6"]) -> Float64[np.ndarray, " region"]:
    """How far, in radians rms, the normals of each region turn with the place: noise has no direction, a bend has."""
    place, mixed = covariance[:, 3:, 3:], covariance[:, :3, 3:]
    inverse = np.linalg.pinv(place, rcond=1e-3, hermitian=True)
    return np.sqrt(np.maximum(np.einsum("rij,rjk,rik->r", mixed, inverse, mixed), 0.0))


def _grown(
    facet: Int32[np.ndarray, " point"], points: ShadingPoints, near: Int32[np.ndarray, "pair 2"], max_deg: float
) -> Int32[np.ndarray, " point"]:
    """Facets with the points of other patches that lie in their plane and are connected to them in it."""
    for index in np.unique(facet[facet >= 0]):
        inside = facet == index
        middle, normal = points.position[inside].mean(axis=0), points.normal[inside].mean(axis=0)
        normal /= np.linalg.norm(normal)
        away = points.position - middle
        extent = np.sqrt((away[inside] ** 2).sum(axis=1).mean())
        is_in_plane = (np.abs(away @ normal) < 0.02 * extent) & (points.normal @ normal > np.cos(np.radians(max_deg)))
        is_in_plane = inside | (is_in_plane & (facet < 0))
        connected = regions.components(len(points), near[is_in_plane[near].all(axis=1)])
        facet = np.where(is_in_plane & np.isin(connected, connected[inside]), index, facet)
    return facet


def is_flat(points: ShadingPoints, panel: Int32[np.ndarray, " point"], flat_deg: float) -> Bool[np.ndarray, " panel"]:
    """Panels nine tenths of whose points have a normal within an angle of the mean."""
    count = np.bincount(panel)
    mean = np.stack([np.bincount(panel, points.normal[:, i]) for i in range(3)], axis=1)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
    is_near = np.einsum("pi,pi->p", points.normal, mean[panel]) > np.cos(np.radians(flat_deg))
    return np.bincount(panel, is_near) >= 0.9 * count


def color_patches(
    points: ShadingPoints, camera: Camera, colors: Float64[np.ndarray, "point 3"], options: SegmentationOptions
) -> Int32[np.ndarray, " point"]:
    """Compact patches of like colour and normal in the picture (SLIC superpixels)."""
    picture = np.zeros((camera.num_pixels, 6), np.float32)
    picture[points.pixel] = np.concatenate([colors / options.floor, points.normal / 0.25], axis=1)
    is_empty = np.ones(camera.num_pixels, bool)
    is_empty[points.pixel] = False
    # Pixels without a point look like the nearest that has one: a speck without light must not be a patch's border.
    nearest = distance_transform_edt(
        is_empty.reshape(camera.height, camera.width), return_distances=False, return_indices=True
    )
    picture = picture.reshape(camera.height, camera.width, 6)[tuple(nearest)]
    # slic brings the picture to 0 .. 1 first; undone, so that one scatter of colour counts as one patch's width.
    compactness = 1.0 / max(float(np.ptp(picture)), 1e-6)
    number = max(1, camera.num_pixels // options.patch_px)
    patch = slic(picture, number, compactness, sigma=1.0, convert2lab=False, enforce_connectivity=False, start_label=0)
    return patch.ravel()[points.pixel].astype(np.int32)


def _number(*keys: np.ndarray) -> Int32[np.ndarray, " point"]:
    """One number for each combination of keys (-1 upward), 0 upward."""
    combined = np.zeros(len(keys[0]), np.int64)
    for key in keys:
        combined = combined * (int(key.max()) + 2) + key + 1
    return regions.renumbered(combined)
