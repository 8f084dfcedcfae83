"""What geometry says before any fit: which point each pixel shows, which lights reach it, where a highlight may be."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32
from scipy import ndimage

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.lights import Light
from relight3d.records import Mirror, Observations, PatchMesh, ShadingPoints
from relight3d.recover.blockers import without_blockers
from relight3d.shading import cast_light, mirrored_light
from relight3d.tracing import RayScene

MAX_DIM = 4.0  # times the usual power, beyond which a photograph's noise is not taken to be smaller


@dataclass(frozen=True)
class VisibilityOptions:
    """How far the geometry is trusted."""

    border_px: float = 1.5  # pixels nearer to a predicted shadow border than this are not believed
    grazing_cosine: float = 0.08  # nor are points that the light grazes: normals are not exact
    highlight_deg: float = 28.0  # half angle about the mirror direction in which a highlight may be
    blockers: bool = True  # leave out parts of photographs in shadows that the mesh does not throw

    def __post_init__(self) -> None:
        if not 0 <= self.border_px <= 50:
            raise InputError("border_px", self.border_px, "0 to 50 pixels")
        if not 0 < self.highlight_deg < 90:
            raise InputError("highlight_deg", self.highlight_deg, "an angle between 0 and 90 degrees")


def observe(
    scene: RayScene,
    mesh: PatchMesh,
    points: ShadingPoints,
    camera: Camera,
    radiance: Float32[np.ndarray, "photo point 3"],
    is_valid: Bool[np.ndarray, "photo point"],
    lights: tuple[tuple[Light, ...], ...],
    options: VisibilityOptions,
    mirrors: tuple[Mirror, ...] = (),
    surface_of_face: np.ndarray | None = None,
    surface: np.ndarray | None = None,
) -> Observations:
    """The photographs at the points, normalised by their lights, with shadows, safe zones and highlight zones.

    `lights` are those of each photograph, in centred coordinates; an empty tuple is a lights-off frame.
    """
    scale = photograph_scales(lights)
    # Of one lamp with all colours every colour has the same share of the form: one stands for all.
    several = any(len(each) > 1 or not all(light.power.all() for light in each) for each in lights)
    num_photos, num_points = is_valid.shape
    form = np.zeros((num_photos, num_points, 3 if several else 1), np.float32)
    is_lit = np.zeros((num_photos, num_points), bool)
    highlight, facing = np.zeros_like(is_lit), np.zeros_like(is_lit)
    safe = np.ones_like(is_lit)
    throwing = [m for m in mirrors if m.throws_light]
    thrown = np.zeros((len(throwing), *form.shape), np.float32) if throwing else None
    thrown_highlight = np.zeros_like(is_lit) if throwing else None
    num_rays = 0
    for photo, each in enumerate(lights):
        for light in each:
            share = (light.power / scale[photo])[None] if several else np.ones((1, 1))
            lit = cast_light(scene, points, light, None, mirrors, surface_of_face)
            num_rays += lit.num_rays + lit.num_thrown_rays
            form[photo] += (lit.form[:, None] * share).astype(np.float32)
            is_lit[photo] |= lit.is_lit
            facing[photo] |= lit.cosine > options.grazing_cosine
            highlight[photo] |= highlight_zone(points, lit.to_light, options.highlight_deg) & lit.is_lit
            safe[photo] &= _away_from_borders(lit.is_lit, points, camera, options.border_px)
            safe[photo] &= np.abs(lit.cosine) > options.grazing_cosine
            if thrown is not None and thrown_highlight is not None and lit.thrown is not None:
                thrown[:, photo] += (lit.thrown[..., None] * share).astype(np.float32)
                for one, patch in zip(throwing, lit.thrown, strict=True):
                    safe[photo] &= _away_from_borders(patch > 0, points, camera, options.border_px)
                    to_image = mirrored_light(light, one).incident(points.position)[0]
                    thrown_highlight[photo] |= highlight_zone(points, to_image, options.highlight_deg) & (patch > 0)
    usable = (scale > 0) & np.isfinite(scale)
    usual = np.array([np.median(one[good]) if good.any() else 1.0 for one, good in zip(scale.T, usable.T)])
    # A lamp that is said to be a thousand times as strong as the others must not be the only one that is believed.
    dim = np.where(usable, np.minimum(scale / usual, MAX_DIM), 0.0)
    weight = is_valid * (np.min(dim, axis=1) ** 2)[:, None]
    normalised = radiance / np.where(usable, scale, 1.0)[:, None, :].astype(np.float32)
    normalised = np.where(is_valid[..., None], normalised, 0.0).astype(np.float32)
    observed = Observations(
        normalised,
        weight.astype(np.float32),
        scale,
        lights,
        form,
        thrown,
        is_lit,
        facing,
        safe,
        highlight,
        interior_points(points, camera, surface),
        num_rays,
        thrown_highlight,
    )
    return without_blockers(observed, points, camera) if options.blockers else observed


def photograph_scales(lights: tuple[tuple[Light, ...], ...]) -> Float64[np.ndarray, "photo 3"]:
    """The summed power of each photograph's lights per colour; for a lights-off one the mean of the others.

    A colour that its lamps do not have gets the mean of those that they have: what it shows is ambient light.
    """
    total = np.array([np.sum([light.power for light in each], axis=0) if each else np.zeros(3) for each in lights])
    is_dark = np.array([not each.any() for each in total])
    if is_dark.all():
        return np.ones_like(total)
    mean = total.sum(axis=1) / np.maximum((total > 0).sum(axis=1), 1)
    total = np.where(total > 0, total, mean[:, None])
    total[is_dark] = total[~is_dark].mean(axis=0)
    return total


def highlight_zone(
    points: ShadingPoints, to_light: Float32[np.ndarray, "point 3"], half_angle_deg: float
) -> Bool[np.ndarray, " point"]:
    """Where the viewer is within an angle of the mirror direction of the light (1.2.1: highlight-free by geometry)."""
    along = 2 * np.einsum("pi,pi->p", points.normal, points.to_viewer)[:, None] * points.normal - points.to_viewer
    return np.einsum("pi,pi->p", along, to_light) > np.cos(np.radians(half_angle_deg))


def _away_from_borders(
    is_lit: Bool[np.ndarray, " point"], points: ShadingPoints, camera: Camera, border_px: float
) -> Bool[np.ndarray, " point"]:
    """Points farther than `border_px` from a pixel of the other state; the picture's own edge is no border."""
    if border_px <= 0:
        return np.ones(len(points), bool)
    state = np.full(camera.num_pixels, -1, np.int8)
    state[points.pixel] = is_lit
    state = state.reshape(camera.height, camera.width)
    radius = int(np.ceil(border_px))
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    disc = x * x + y * y <= border_px * border_px + 0.25
    near_lit = ndimage.binary_dilation(state == 1, disc)
    near_dark = ndimage.binary_dilation(state == 0, disc)
    return ~(near_lit & near_dark).ravel()[points.pixel]


def interior_points(
    points: ShadingPoints, camera: Camera, surface: Int32[np.ndarray, " point"] | None
) -> Bool[np.ndarray, " point"]:
    """Points whose eight neighbours in the picture lie on the same surface, without a crease or a jump in depth."""
    grid = np.full((camera.height + 2, camera.width + 2), -1, np.int64)
    y, x = np.divmod(points.pixel, camera.width)
    grid[y + 1, x + 1] = np.arange(len(points))
    inside = np.ones(len(points), bool)
    at_rim = (y == 0) | (x == 0) | (y == camera.height - 1) | (x == camera.width - 1)
    for dy, dx in ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (-1, 1), (1, -1)):
        other = grid[y + 1 + dy, x + 1 + dx]
        there = np.maximum(other, 0)
        alike = np.abs(points.depth - points.depth[there]) < 0.06 * np.maximum(points.depth, points.depth[there])
        alike &= np.einsum("pi,pi->p", points.normal, points.normal[there]) > 0.85
        if surface is not None:
            alike &= surface == surface[there]
        # Beyond the picture's rim nothing is known, and nothing is mixed in.
        beyond = at_rim & ((y + dy < 0) | (x + dx < 0) | (y + dy >= camera.height) | (x + dx >= camera.width))
        inside &= np.where(other >= 0, alike, beyond)
    return inside
