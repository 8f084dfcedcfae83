"""What each pixel of a view shows: hits, mirrors followed, and the recovered properties looked up at every point.

Nothing here depends on the light. The captured view reads its own pixels; another view, and every mirror, projects
its points into the captured view and reads there, where the same spot was seen; elsewhere the vertices' albedo and the
mesh's normal stand in. A pixel on an outline, of an object or of its mirror image, is cut into several points that
share it, as a photograph's pixel mixes what it covers.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float32, Int32

from relight3d.camera import Camera
from relight3d.outlines import cut_pixels, is_break
from relight3d.records import RelightModel, ShadingPoints
from relight3d.shading import points_mirrored, points_seen, reflected
from relight3d.tracing import RayScene


@dataclass(frozen=True)
class ViewOptions:
    """What a view follows. Each is priced: `edge_samples` by points, `max_bounces` by points in mirrors."""

    edge_samples: int = 4  # points that a pixel on an outline is cut into (a square number; 1: none)
    max_bounces: int = 2  # mirrors followed one after the other; 0 shows mirrors black


@dataclass(frozen=True, eq=False)
class View:
    """All points of a view and what is known at them. Structure of arrays; several points may share a pixel."""

    camera: Camera
    points: ShadingPoints
    surface: Int32[np.ndarray, " point"]
    albedo: Float32[np.ndarray, "point 3"]
    normal: Float32[np.ndarray, "point 3"]
    lobe_gain: Float32[np.ndarray, " point"]
    throughput: Float32[np.ndarray, "point 3"]  # the point's share of its pixel, times the mirrors on the way
    is_mirrored: Bool[np.ndarray, " point"]
    source: Int32[np.ndarray, "point 4"]  # captured points that a value is read from (-1: none), and their shares
    share: Float32[np.ndarray, "point 4"]
    step: Float32[np.ndarray, "point 2 3"]  # how the point moves per pixel to the right and down, in its plane
    neighbour: Int32[np.ndarray, "point 4"]  # points right, left, below, above, of the same surface; -1 for none
    miss_pixel: Int32[np.ndarray, " miss"]  # pixels whose mirror shows the surroundings
    miss_source: Int32[np.ndarray, " miss"]  # the row of Background they read
    miss_throughput: Float32[np.ndarray, " miss"]  # share of the pixel
    is_hit: Bool[np.ndarray, "height width"]
    num_rays: int

    def take(self, index: np.ndarray) -> "View":
        """Some of the points, on their own: without neighbours, so without soft borders."""
        names = ("surface", "albedo", "normal", "lobe_gain", "throughput", "is_mirrored", "source", "share", "step")
        alone = np.full((len(index), 4), -1, np.int32)
        given = {field.name: getattr(self, field.name) for field in fields(View)}
        given |= {name: given[name][index] for name in names}
        return View(**given | {"points": self.points.take(index), "neighbour": alone})


def build_view(scene: RayScene, model: RelightModel, camera: Camera, options: ViewOptions = ViewOptions()) -> View:
    """Trace the view and look everything up."""
    captured = camera.same_as(model.camera)
    centres = model.pixels.points if captured else points_seen(scene, model.mesh, camera)
    num_rays = 0 if captured else camera.num_pixels
    is_hit = np.zeros(camera.num_pixels, bool)
    is_hit[centres.pixel] = True
    followed = _follow(scene, model, centres, np.ones(len(centres), np.float32), options.max_bounces)
    if options.edge_samples > 1:
        on_edge = centres.pixel[_outlines(model, camera, followed)[centres.pixel]]
        # What every photograph is compared with is looked at once, and so more closely.
        parts, weight, rays = cut_pixels(scene, model, camera, on_edge, options.edge_samples, captured)
        num_rays += rays
        cut = np.zeros(camera.num_pixels, bool)
        cut[parts.pixel] = True
        centre_left = centres.take(~cut[centres.pixel])
        weight = np.concatenate([np.ones(len(centre_left)), weight]).astype(np.float32)
        followed = _follow(scene, model, _joined(centre_left, parts), weight, options.max_bounces)
    else:
        cut = np.zeros(camera.num_pixels, bool)
    return _assembled(model, camera, followed, cut, is_hit, num_rays + followed.num_rays)


# --------------------------------------------------------------------------------------------- rays


@dataclass(frozen=True, eq=False)
class _Followed:
    """Points after all mirrors, what the mirrors left of their light, and the pixels that ended in the surroundings."""

    points: ShadingPoints
    throughput: np.ndarray  # point x 3
    mirrors: np.ndarray  # point x 3 x 3: the product of the mirrors' reflections, which turns image steps
    is_mirrored: np.ndarray
    miss: ShadingPoints  # the last mirror point of each
    miss_share: np.ndarray
    num_rays: int


def _follow(
    scene: RayScene, model: RelightModel, points: ShadingPoints, share: np.ndarray, max_bounces: int
) -> _Followed:
    reflectance = np.zeros((model.surfaces.num_surfaces, 3), np.float32)
    for mirror in model.mirrors:
        reflectance[mirror.surface] = mirror.reflectance
    is_mirror = reflectance.any(axis=1)
    surface = model.surfaces.surface_of_face
    on = is_mirror[surface[points.face]]
    done = [(points.take(~on), np.repeat(share[~on, None], 3, axis=1), _identity(int((~on).sum())), False)]
    waiting, carried, turn = points.take(on), share[on, None] * reflectance[surface[points.face[on]]], None
    shares, lost, num_rays = share[on], [], 0
    turn = _identity(len(waiting))
    for _ in range(max_bounces if len(waiting) else 0):
        order = np.arange(len(waiting))
        shown = points_mirrored(scene, model.mesh, replace(waiting, pixel=order.astype(np.int32)))
        came = shown.pixel
        num_rays += len(waiting)
        gone = np.setdiff1d(order, came)
        lost.append((waiting.take(gone), shares[gone]))
        flips = np.eye(3, dtype=np.float32) - 2 * waiting.normal[came][:, :, None] * waiting.normal[came][:, None]
        turn = flips @ turn[came]
        shown = replace(shown, pixel=waiting.pixel[came])
        carried, shares = carried[came], shares[came]
        again = is_mirror[surface[shown.face]]
        done.append((shown.take(~again), carried[~again], turn[~again], True))
        waiting, turn, shares = shown.take(again), turn[again], shares[again]
        carried = carried[again] * reflectance[surface[waiting.face]]
        if len(waiting) == 0:
            break
    return _Followed(
        _joined(*[d[0] for d in done]),
        np.concatenate([d[1] for d in done]).astype(np.float32),
        np.concatenate([d[2] for d in done]),
        np.concatenate([np.full(len(d[0]), d[3]) for d in done]),
        _joined(points.take(np.zeros(0, int)), *[part for part, _ in lost]),
        np.concatenate([np.zeros(0, np.float32), *[s for _, s in lost]]),
        num_rays,
    )


def _identity(num: int) -> np.ndarray:
    return np.broadcast_to(np.eye(3, dtype=np.float32), (num, 3, 3))


def _joined(*parts: ShadingPoints) -> ShadingPoints:
    return ShadingPoints(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(ShadingPoints)})


def _outlines(model: RelightModel, camera: Camera, followed: _Followed) -> Bool[np.ndarray, " pixel"]:
    """Pixels next to one that shows another surface, another side of a crease, or something far behind."""
    shape = (camera.height, camera.width)
    points = followed.points
    label = np.full(camera.num_pixels, -1, np.int32)
    label[points.pixel] = model.surfaces.surface_of_face[points.face] * 2 + followed.is_mirrored
    label[followed.miss.pixel] = -2
    depth = np.zeros(camera.num_pixels, np.float32)
    depth[points.pixel] = points.depth
    normal = np.zeros((camera.num_pixels, 3), np.float32)
    normal[points.pixel] = points.normal
    label, depth, normal = label.reshape(shape), depth.reshape(shape), normal.reshape(*shape, 3)
    edge = np.zeros(shape, bool)
    for axis in (0, 1):
        here = tuple(slice(None, -1) if a == axis else slice(None) for a in (0, 1))
        ahead = tuple(slice(1, None) if a == axis else slice(None) for a in (0, 1))
        differs = label[here] != label[ahead]
        differs |= is_break(depth[here], depth[ahead], normal[here], normal[ahead]) & (label[here] >= 0)
        edge[here] |= differs
        edge[ahead] |= differs
    return edge.ravel()


def _steps(camera: Camera, points: ShadingPoints, turn: np.ndarray) -> Float32[np.ndarray, "point 2 3"]:
    """How a point slides in its plane when its pixel moves by one to the right or down, mirrors included."""
    axes = camera.world_from_camera[:3, :3].astype(np.float32)
    away = -points.to_viewer
    facing = np.einsum("pi,pi->p", points.geometric_normal, away)
    facing = np.minimum(facing, -0.08)  # a grazed plane would be stepped across in one pixel
    out = np.empty((len(points), 2, 3), np.float32)
    for k, way in enumerate((axes[:, 0] / camera.fx, -axes[:, 1] / camera.fy)):
        image_step = np.einsum("pij,j->pi", turn, way.astype(np.float32)) * points.depth[:, None]
        slide = np.einsum("pi,pi->p", points.geometric_normal, image_step) / facing
        out[:, k] = image_step - slide[:, None] * away
    return out


def _neighbours(camera: Camera, points: ShadingPoints, surface: np.ndarray, cut: np.ndarray, mirrored: np.ndarray):
    grid = np.full((camera.height + 2) * (camera.width + 2), -1, np.int32)
    y, x = np.divmod(points.pixel, camera.width)
    place = (y + 1) * (camera.width + 2) + x + 1
    whole = ~cut[points.pixel]
    grid[place[whole]] = np.flatnonzero(whole)
    out = np.full((len(points), 4), -1, np.int32)
    for k, shift in enumerate((1, -1, camera.width + 2, -camera.width - 2)):
        other = grid[place + shift]
        there = np.maximum(other, 0)
        same = whole & (other >= 0) & (surface[there] == surface) & (mirrored[there] == mirrored)
        out[:, k] = np.where(same, other, -1)
    return out


# --------------------------------------------------------------------------------------------- properties


def _assembled(model: RelightModel, camera: Camera, followed: _Followed, cut, is_hit, num_rays: int) -> View:
    points, mirrored = followed.points, followed.is_mirrored
    surface = model.surfaces.surface_of_face[points.face]
    source, share = look_up(model, points)
    if camera.same_as(model.camera):
        index = np.full(camera.num_pixels, -1, np.int32)
        index[model.pixels.points.pixel] = np.arange(len(model.pixels.points), dtype=np.int32)
        itself = ~mirrored & ~cut[points.pixel]
        source[itself], share[itself] = -1, 0.0
        source[itself, 0], share[itself, 0] = index[points.pixel[itself]], 1.0
    known = np.clip(share.sum(axis=1, keepdims=True), 0.0, 1.0)
    partly = np.flatnonzero(known[:, 0] < 1)
    corners = model.mesh.faces[points.face[partly]]
    unseen = np.zeros((len(points), 3), np.float32)
    unseen[partly] = np.einsum("pk,pkc->pc", points.barycentric[partly], model.albedo_unseen[corners])
    tilt = read(model.pixels.normal - model.pixels.points.normal, source, share)
    normal = points.normal + tilt
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-6)
    return View(
        camera=camera,
        points=points,
        surface=surface,
        albedo=(read(model.pixels.albedo, source, share) + (1 - known) * unseen).astype(np.float32),
        normal=normal.astype(np.float32),
        lobe_gain=(read(model.pixels.lobe_gain, source, share) + 1 - known[:, 0]).astype(np.float32),
        throughput=followed.throughput,
        is_mirrored=mirrored,
        source=source,
        share=share,
        step=_steps(camera, points, followed.mirrors),
        neighbour=_neighbours(camera, points, surface, cut, mirrored),
        miss_pixel=followed.miss.pixel,
        miss_source=_nearest_background(model, followed.miss.pixel, reflected(followed.miss), camera),
        miss_throughput=followed.miss_share.astype(np.float32),
        is_hit=is_hit.reshape(camera.height, camera.width),
        num_rays=num_rays,
    )


def look_up(
    model: RelightModel, points: ShadingPoints
) -> tuple[Int32[np.ndarray, "point 4"], Float32[np.ndarray, "point 4"]]:
    """The four captured pixels around each point's image, and their bilinear shares.

    Shares sum to 1 where all four see the same spot (same surface, near in space, alike in normal) and to 0 where none
    does. Where one to three do, they are brought to a sum of 1 as far as they carry at least a quarter, which leaves
    a narrow, smooth seam instead of a step.
    """
    pixels, camera = model.pixels, model.camera
    image, depth = camera.project(points.position.astype(np.float64) + model.mesh.center)
    index = np.full(camera.num_pixels + 1, -1, np.int32)
    index[pixels.points.pixel] = np.arange(len(pixels.points), dtype=np.int32)
    image = np.clip(np.where(np.isfinite(image), image, -10.0), -10.0, max(camera.width, camera.height) + 10.0)
    corner = np.floor(image - 0.5).astype(np.int64)
    part = image - 0.5 - corner
    footprint = np.maximum(depth, 0) / min(camera.fx, camera.fy)
    surface = model.surfaces.surface_of_face[points.face]
    source = np.full((len(points), 4), -1, np.int32)
    share = np.zeros((len(points), 4), np.float32)
    for k, (dx, dy) in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
        x, y = corner[:, 0] + dx, corner[:, 1] + dy
        inside = (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height) & (depth > 0)
        found = index[np.where(inside, y * camera.width + x, camera.num_pixels)]
        there = np.maximum(found, 0)
        apart = np.linalg.norm(pixels.points.position[there] - points.position, axis=1)
        slant = np.abs(np.einsum("pi,pi->p", pixels.points.geometric_normal[there], pixels.points.to_viewer[there]))
        same = (found >= 0) & (pixels.surface[there] == surface)
        same &= apart < 3.0 * footprint / np.maximum(slant, 0.1)
        same &= np.einsum("pi,pi->p", pixels.points.normal[there], points.normal) > 0.7
        weight = (part[:, 0] if dx else 1 - part[:, 0]) * (part[:, 1] if dy else 1 - part[:, 1])
        source[:, k] = np.where(same, found, -1)
        share[:, k] = np.where(same, weight, 0.0)
    return source, share / np.maximum(share.sum(axis=1, keepdims=True), 0.25)


def read(values: np.ndarray, source: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Values of captured points, blended by shares; 0 where nothing was seen."""
    return np.einsum("pk,pk...->p...", share, values[np.maximum(source, 0)])


def _nearest_background(model: RelightModel, pixel, toward, camera: Camera) -> Int32[np.ndarray, " miss"]:
    """The row of the background that each miss reads: its own pixel, or what looked most nearly the same way."""
    background = model.background
    if background is None or len(pixel) == 0 or len(background.pixel) == 0:
        return np.full(len(pixel), -1, np.int32)
    from scipy.spatial import cKDTree

    nearest = cKDTree(background.toward).query(toward)[1].astype(np.int32)
    if camera.same_as(model.camera):
        rows = np.full(camera.num_pixels, -1, np.int32)
        rows[background.pixel] = np.arange(len(background.pixel), dtype=np.int32)
        return np.where(rows[pixel] >= 0, rows[pixel], nearest)
    return nearest
