"""A new viewpoint by compiled loops: the View that views.build_view makes, several times as fast.

Mirrors are followed once for the pixels' centres, and again only for the pixels on outlines that are cut.
"""

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Bool, Float32, Int32

from relight3d import views
from relight3d.camera import Camera
from relight3d.records import PixelMap, RelightModel, ShadingPoints
from relight3d.relight import view_kernels
from relight3d.relight.tiles import tiles
from relight3d.shading import NUDGE_PX, reflected
from relight3d.tracing import RayScene, over_threads
from relight3d.views import View, ViewOptions
from relight3d.views import _Followed as Followed

NO_WAY = np.zeros(0, np.float32)
NO_TURN = np.zeros((0, 3, 3), np.float32)

# What every viewpoint of a model reads of its captured pixels.
_kept: "WeakKeyDictionary[PixelMap, tuple[np.ndarray, np.ndarray]]" = WeakKeyDictionary()


def build_fast_view(scene: RayScene, model: RelightModel, camera: Camera, options: ViewOptions) -> View:
    """What a camera other than the captured one sees."""
    maker = _ViewMaker(scene, model, camera, options)
    centres = maker.trace_centres()
    num_pixels, num_rays = camera.num_pixels, camera.num_pixels
    is_hit, cut = np.zeros(num_pixels, bool), np.zeros(num_pixels, bool)
    is_hit[centres.pixel] = True
    followed = maker.follow(centres, np.ones(len(centres), np.float32))
    num_rays += followed.num_rays
    if options.edge_samples > 1:
        on_edge = views._outlines(model, camera, followed)[centres.pixel]
        pixels, image_points = views._subpixels(camera, centres.pixel[on_edge], options.edge_samples)
        parts = maker.trace(pixels.astype(np.int32), camera.directions(image_points).astype(np.float32))
        hits = np.bincount(parts.pixel, minlength=num_pixels)
        cut[centres.pixel[on_edge]] = hits[centres.pixel[on_edge]] > 0
        shares = (1.0 / hits[parts.pixel]).astype(np.float32)
        num_rays += len(pixels)
        of_parts = maker.follow(parts, shares)
        followed = _joined(_without(followed, cut), of_parts)
        num_rays += of_parts.num_rays
    return maker.assemble(followed, cut, is_hit, num_rays)


class _ViewMaker:
    def __init__(self, scene: RayScene, model: RelightModel, camera: Camera, options: ViewOptions) -> None:
        self.scene, self.model, self.camera, self.options = scene, model, camera, options
        mesh = model.mesh
        self._mesh = (mesh.faces, mesh.centered_vertices, mesh.vertex_normals, mesh.face_normals)
        self._reflectance = np.zeros((model.surfaces.num_surfaces, 3), np.float32)
        for mirror in model.mirrors:
            self._reflectance[mirror.surface] = mirror.reflectance
        self._is_mirror = self._reflectance.any(axis=1)

    def trace_centres(self) -> ShadingPoints:
        camera = self.camera
        directions = np.empty((camera.num_pixels, 3), np.float32)
        if any((camera.k1, camera.k2, camera.p1, camera.p2)):
            rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
            centres = np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], axis=1)
            directions[:] = camera.directions(centres + NUDGE_PX)
        else:
            axes = camera.world_from_camera[:3, :3]
            right, down = axes[:, 0] / camera.fx, -axes[:, 1] / camera.fy
            corner = -axes[:, 2] - (camera.cx - NUDGE_PX[0]) * right - (camera.cy - NUDGE_PX[1]) * down

            def aim(part: slice) -> None:
                view_kernels.pixel_rays(part.start, part.stop, corner, right, down, camera.width, directions)

            over_threads(aim, tiles(camera.num_pixels))
        return self.trace(np.arange(camera.num_pixels, dtype=np.int32), directions)

    def trace(
        self,
        pixel: Int32[np.ndarray, " ray"],
        directions: Float32[np.ndarray, "ray 3"],
        origins: Float32[np.ndarray, "ray 3"] | None = None,
        way: np.ndarray = NO_WAY,
    ) -> ShadingPoints:
        """What rays see, from the camera or from `origins`; each kept under its pixel."""
        from_camera = origins is None
        if origins is None:
            eye = (self.camera.center - self.model.mesh.center).astype(np.float32)
            origins = np.ascontiguousarray(np.broadcast_to(eye, directions.shape))
        found = self.scene.first_hit(origins, directions, coherent=from_camera)
        hit = np.flatnonzero(found.face >= 0).astype(np.int32)
        num = len(hit)
        barycentric, position, geometric, normal, to_viewer = (np.empty((num, 3), np.float32) for _ in range(5))
        depth = np.empty(num, np.float32)

        def place(part: slice) -> None:
            rays = (hit, found.face, found.u, found.v, found.distance, directions, way)
            out = (barycentric, position, geometric, normal, to_viewer, depth)
            view_kernels.points_at_hits(part.start, part.stop, *rays, *self._mesh, *out)

        over_threads(place, tiles(num))
        return ShadingPoints(pixel[hit], found.face[hit], barycentric, position, geometric, normal, to_viewer, depth)

    def follow(self, points: ShadingPoints, share: Float32[np.ndarray, " point"]) -> Followed:
        """Points that mirrors do not hide, then those that are seen in mirrors; as views._follow."""
        surface_of_face = self.model.surfaces.surface_of_face
        on = self._is_mirror[surface_of_face[points.face]]
        none = points.take(np.zeros(0, np.int64))
        if not on.any():
            shares = np.repeat(share[:, None], 3, axis=1)
            return Followed(points, shares, NO_TURN, np.zeros(len(points), bool), none, NO_WAY, 0)
        return Followed(
            *views._follow(self.scene, self.model, points, share, self.options.max_bounces).__dict__.values()
        )

    def assemble(self, followed: Followed, cut: np.ndarray, is_hit: np.ndarray, num_rays: int) -> View:
        """views._assembled, compiled."""
        model, camera, points = self.model, self.camera, followed.points
        num, surface = len(points), model.surfaces.surface_of_face[points.face]
        source, share = np.empty((num, 4), np.int32), np.empty((num, 4), np.float32)
        albedo, normal = np.empty((num, 3), np.float32), np.empty((num, 3), np.float32)
        gain, step = np.empty(num, np.float32), np.empty((num, 2, 3), np.float32)
        neighbour, point_of_pixel = np.empty((num, 4), np.int32), np.full(camera.num_pixels, -1, np.int32)
        whole = ~cut[points.pixel]
        point_of_pixel[points.pixel[whole]] = np.flatnonzero(whole)
        seen, eye, (row_of_pixel, tilt) = model.pixels, model.camera, _captured(model)
        lens = np.array([eye.fx, eye.fy, eye.cx, eye.cy, eye.k1, eye.k2, eye.p1, eye.p2])
        project = (lens, np.ascontiguousarray(eye.world_from_camera[:3, :3]), eye.center - model.mesh.center)
        captured = (seen.points.position, seen.points.geometric_normal, seen.points.to_viewer, seen.points.normal)
        properties = (model.surface_albedo.astype(np.float32), seen.albedo, tilt)
        axes = camera.world_from_camera[:3, :3].astype(np.float32)
        per_pixel = (np.ascontiguousarray(axes[:, 0]) / np.float32(camera.fx), -axes[:, 1] / np.float32(camera.fy))
        turn = np.ascontiguousarray(followed.mirrors, np.float32)

        def fill(part: slice) -> None:
            ends = (part.start, part.stop)
            view_kernels.look_up(
                *ends, *project, eye.width, eye.height, row_of_pixel, *captured, seen.surface, points.position,
                points.normal, surface, source, share,
            )  # fmt: skip
            view_kernels.read_properties(
                *ends, source, share, surface, *properties, seen.lobe_gain, points.normal, albedo, normal, gain
            )
            view_kernels.steps(*ends, *per_pixel, turn, points.geometric_normal, points.to_viewer, points.depth, step)
            picture = (camera.width, camera.height, points.pixel, point_of_pixel)
            view_kernels.neighbours(*ends, *picture, surface, followed.is_mirrored, neighbour)

        over_threads(fill, tiles(num))
        miss = views._nearest_background(model, followed.miss.pixel, reflected(followed.miss), camera)
        return View(
            camera, points, surface, albedo, normal, gain, followed.throughput, followed.is_mirrored, source, share,
            step, neighbour, followed.miss.pixel, miss, followed.miss_share.astype(np.float32),
            is_hit.reshape(camera.height, camera.width), num_rays,
        )  # fmt: skip


def _captured(model: RelightModel) -> tuple[Int32[np.ndarray, " pixel"], Float32[np.ndarray, "point 3"]]:
    """The captured point of each pixel (-1 for none), and how far detail turns its normal."""
    seen = model.pixels
    if seen not in _kept:
        row_of_pixel = np.full(model.camera.num_pixels, -1, np.int32)
        row_of_pixel[seen.points.pixel] = np.arange(len(seen.points), dtype=np.int32)
        _kept[seen] = (row_of_pixel, seen.normal - seen.points.normal)
    return _kept[seen]


def _without(followed: Followed, cut: Bool[np.ndarray, " pixel"]) -> Followed:
    """What is left of the pixels' centres when some pixels are cut."""
    keep, lost = ~cut[followed.points.pixel], ~cut[followed.miss.pixel]
    return replace(
        followed,
        points=followed.points.take(keep),
        throughput=followed.throughput[keep],
        mirrors=followed.mirrors[keep] if len(followed.mirrors) else followed.mirrors,
        is_mirrored=followed.is_mirrored[keep],
        miss=followed.miss.take(lost),
        miss_share=followed.miss_share[lost],
    )


def _joined(one: Followed, two: Followed) -> Followed:
    turns = NO_TURN
    if len(one.mirrors) or len(two.mirrors):
        turns = np.concatenate([f.mirrors if len(f.mirrors) else views._identity(len(f.points)) for f in (one, two)])
    return Followed(
        views._joined(one.points, two.points),
        np.concatenate([one.throughput, two.throughput]),
        turns,
        np.concatenate([one.is_mirrored, two.is_mirrored]),
        views._joined(one.miss, two.miss),
        np.concatenate([one.miss_share, two.miss_share]),
        one.num_rays + two.num_rays,
    )
