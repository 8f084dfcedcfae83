"""A new viewpoint by compiled loops: the View that views.build_view makes, many times as fast.

Pixels are walked in blocks of 4 x 4, each a packet of rays; their place in that order is their seat. Mirrors are
followed at once, and the pixels on outlines are looked at again. The points of the view end up in the order of the
seats, which is the one that the engine's buffers want, so that it need not copy them.
"""

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Bool, Float32, Int32

from relight3d import views
from relight3d.camera import Camera
from relight3d.records import PixelMap, RelightModel, ShadingPoints
from relight3d.relight import look_kernels, view_kernels
from relight3d.relight.tiles import pixel_of_seat, tiles
from relight3d.shading import NUDGE_PX
from relight3d.tracing import RayScene, over_threads
from relight3d.views import View, ViewOptions


class Rays(NamedTuple):
    """Where rays end, as look_kernels.look leaves it: one for each seat, then those of the pixels looked at again."""

    face: Int32[np.ndarray, " ray"]
    u: Float32[np.ndarray, " ray"]
    v: Float32[np.ndarray, " ray"]
    depth: Float32[np.ndarray, " ray"]
    toward: Float32[np.ndarray, "ray 3"]
    bounces: np.ndarray
    tint: Float32[np.ndarray, "ray 3"]
    turned: Float32[np.ndarray, "ray 2 3"]


class Listed(NamedTuple):
    """The view's points by the rays that end in them, and the rays that a mirror sent to the surroundings."""

    ray: Int32[np.ndarray, " point"]
    part: Float32[np.ndarray, " point"]
    pixel: Int32[np.ndarray, " point"]
    is_cut: Bool[np.ndarray, " pixel"]
    lost: Int32[np.ndarray, " miss"]
    lost_part: Float32[np.ndarray, " miss"]
    lost_pixel: Int32[np.ndarray, " miss"]


class Captured(NamedTuple):
    """What every viewpoint of a model reads of its captured pixels."""

    row_of_pixel: Int32[np.ndarray, " pixel"]  # the captured point of each pixel, -1 for none
    seen: Float32[np.ndarray, "point column"]  # view_kernels.SEEN_PLACE and on


_captured: "WeakKeyDictionary[PixelMap, Captured]" = WeakKeyDictionary()


def build_fast_view(scene: RayScene, model: RelightModel, camera: Camera, options: ViewOptions) -> View:
    """What a camera other than the captured one sees. The scene must have packets."""
    return _Looker(scene, model, camera, options).view()


class _Looker:
    def __init__(self, scene: RayScene, model: RelightModel, camera: Camera, options: ViewOptions) -> None:
        self.scene, self.model, self.camera, self.options = scene, model, camera, options
        mesh = model.mesh
        self._mesh = (mesh.faces, mesh.centered_vertices, mesh.vertex_normals, mesh.face_normals)
        self._surface_of_face = model.surfaces.surface_of_face
        self._reflectance = np.zeros((model.surfaces.num_surfaces, 3), np.float32)
        for mirror in model.mirrors:
            self._reflectance[mirror.surface] = mirror.reflectance
        axes = camera.world_from_camera[:3, :3].astype(np.float32)
        self._ways = np.stack([axes[:, 0] / camera.fx, -axes[:, 1] / camera.fy]).astype(np.float32)
        self._pixel_of_seat = pixel_of_seat(camera.width, camera.height)
        # Room for every pixel on an outline; what is not used is never touched.
        num = camera.num_pixels * (1 + (options.edge_samples if options.edge_samples > 1 else 0))
        whole, triple = (lambda: np.empty(num, np.float32)), (lambda: np.empty((num, 3), np.float32))
        self._rays = Rays(
            np.empty(num, np.int32), whole(), whole(), whole(), triple(), np.empty(num, np.uint8), triple(),
            np.empty((num, 2, 3), np.float32),
        )  # fmt: skip

    def view(self) -> View:
        num_rays = self._look(self._pixel_of_seat, np.full(1, 0.5), np.full(1, 0.5), 0)
        cut, samples = np.zeros(0, np.int32), self.options.edge_samples
        if samples > 1:
            cut, side = self._outlines(), round(samples**0.5)
            y, x = (np.mgrid[0:side, 0:side].reshape(2, -1) + 0.5) / side
            num_rays += self._look(self._pixel_of_seat[cut], x, y, self.camera.num_pixels)
        return self._view(self._listed(cut), num_rays)

    # ------------------------------------------------------------------------------------- rays

    def _look(self, pixel: Int32[np.ndarray, " pixel"], x: np.ndarray, y: np.ndarray, begin: int) -> int:
        """Looks through places (x, y) in each pixel; the rays stand from `begin` on. Returns how many were cast."""
        camera, rays, packets = self.camera, self._rays, self.scene.packets
        assert packets is not None
        num, x, y = len(pixel) * len(x), x + NUDGE_PX[0], y + NUDGE_PX[1]
        mine = Rays(*(each[begin : begin + num] for each in rays))
        axes = camera.world_from_camera[:3, :3]
        right, down = np.ascontiguousarray(axes[:, 0]) / camera.fx, -axes[:, 1] / camera.fy
        corner = -axes[:, 2] - camera.cx * right - camera.cy * down
        has_lens = any((camera.k1, camera.k2, camera.p1, camera.p2))
        if has_lens:
            places = np.stack([(pixel % camera.width)[:, None] + x, (pixel // camera.width)[:, None] + y], axis=-1)
            mine.toward[:] = camera.directions(places.reshape(-1, 2))
        eye = (camera.center - self.model.mesh.center).astype(np.float32)
        scene = (packets.intersect, packets.scene, packets.arguments, self.scene.offset_distance, eye, self._ways)

        def look(part: slice) -> int:
            if not has_lens:
                first, last = part.start // len(x), part.stop // len(x)
                look_kernels.pixel_rays(first, last, pixel, x, y, corner, right, down, camera.width, mine.toward)
            return look_kernels.look(
                part.start, part.stop, *scene, self.options.max_bounces, self._reflectance, self._surface_of_face,
                self._mesh, *mine,
            )  # fmt: skip

        return num + sum(over_threads(look, tiles(num, 16 * len(x))))

    def _outlines(self) -> Int32[np.ndarray, " cut"]:
        """The seats of pixels next to one that shows something else, as views._outlines."""
        camera, rays, num = self.camera, self._rays, self.camera.num_pixels
        label, far, normal = np.empty(num, np.int32), np.empty(num, np.float32), np.empty((3, num), np.float32)
        given = (self._surface_of_face, self._mesh, rays.face, rays.u, rays.v, rays.depth, rays.toward, rays.bounces)
        beside, below = np.zeros(num, bool), np.zeros(num, bool)

        def label_them(part: slice) -> None:
            look_kernels.label_pixels(part.start, part.stop, self._pixel_of_seat, *given, label, far, normal)

        def compare(part: slice) -> None:
            for stride, breaks in ((1, beside), (camera.width, below)):
                last = min(part.stop, num - stride)
                if part.start < last:
                    look_kernels.find_breaks(part.start, last, stride, label, far, normal, breaks)

        over_threads(label_them, tiles(num))
        over_threads(compare, tiles(num))
        seats = np.empty(num, np.int32)
        shape = (camera.width, camera.height)
        return seats[: look_kernels.cut_seats(self._pixel_of_seat, *shape, beside, below, rays.face, seats)]

    def _listed(self, cut: Int32[np.ndarray, " cut"]) -> Listed:
        num, samples = self.camera.num_pixels, self.options.edge_samples
        room = num + len(cut) * samples
        ray, pixel, lost, lost_pixel = (np.empty(room, np.int32) for _ in range(4))
        part, lost_part = np.empty(room, np.float32), np.empty(room, np.float32)
        is_cut = np.zeros(num, bool)
        num_points, num_lost = look_kernels.list_points(
            self._pixel_of_seat, self._rays.face, cut, samples, ray, part, pixel, is_cut, lost, lost_part, lost_pixel
        )
        points, misses = slice(0, num_points), slice(0, num_lost)
        return Listed(
            ray[points], part[points], pixel[points], is_cut, lost[misses], lost_part[misses], lost_pixel[misses]
        )

    # ------------------------------------------------------------------------------------- points

    def _view(self, listed: Listed, num_rays: int) -> View:
        model, camera, rays, num = self.model, self.camera, self._rays, len(listed.ray)
        position, geometric, mesh_normal, to_viewer, throughput, albedo, normal = (
            np.empty((3, num), np.float32) for _ in range(7)
        )
        face, surface, depth, gain = (np.empty(num, kind) for kind in (np.int32, np.int32, np.float32, np.float32))
        barycentric, is_mirrored = np.empty((num, 3), np.float32), np.empty(num, bool)
        source, share = np.empty((num, 4), np.int32), np.empty((num, 4), np.float32)
        step, neighbour = np.empty((num, 2, 3), np.float32), np.empty((num, 4), np.int32)
        eye, captured = model.camera, captured_of(model)
        lens = np.array([eye.fx, eye.fy, eye.cx, eye.cy, eye.k1, eye.k2, eye.p1, eye.p2])
        project = (lens, np.ascontiguousarray(eye.world_from_camera[:3, :3]), eye.center - model.mesh.center)
        mean = model.surface_albedo.astype(np.float32)
        point_of_pixel = np.full(camera.num_pixels, -1, np.int32)

        def fill(part: slice) -> None:
            ends = (part.start, part.stop)
            view_kernels.place_points(
                *ends, listed.ray, listed.part, *rays[:-1], self._mesh, self._surface_of_face, face, barycentric,
                position, geometric, mesh_normal, to_viewer, depth, surface, is_mirrored, throughput,
            )  # fmt: skip
            where = (position, mesh_normal, surface)
            view_kernels.look_up(*ends, *project, eye.width, eye.height, *captured, *where, source, share)
            out = (albedo, normal, gain)
            view_kernels.read_properties(*ends, source, share, surface, mean, captured.seen, mesh_normal, *out)
            turns = (self._ways, listed.ray, rays.bounces, rays.turned)
            view_kernels.steps(*ends, *turns, geometric, to_viewer, depth, step)
            view_kernels.mark_whole(*ends, listed.pixel, listed.is_cut, point_of_pixel)

        def join(part: slice) -> None:
            picture = (camera.width, camera.height, listed.pixel, point_of_pixel)
            view_kernels.neighbours(part.start, part.stop, *picture, surface, is_mirrored, neighbour)

        over_threads(fill, tiles(num))
        over_threads(join, tiles(num))
        is_hit = np.empty(camera.num_pixels, bool)
        is_hit[self._pixel_of_seat] = rays.face[: camera.num_pixels] != look_kernels.NOTHING
        points = ShadingPoints(
            listed.pixel, face, barycentric, position.T, geometric.T, mesh_normal.T, to_viewer.T, depth
        )
        miss = views._nearest_background(model, listed.lost_pixel, rays.toward[listed.lost], camera)
        return View(
            camera, points, surface, albedo.T, normal.T, gain, throughput.T, is_mirrored, source, share, step,
            neighbour, listed.lost_pixel, miss, listed.lost_part, is_hit.reshape(camera.height, camera.width), num_rays,
        )  # fmt: skip


def captured_of(model: RelightModel) -> Captured:
    """What viewpoints read of the model's captured pixels, made once."""
    pixels, points = model.pixels, model.pixels.points
    if pixels not in _captured:
        row_of_pixel = np.full(model.camera.num_pixels, -1, np.int32)
        row_of_pixel[points.pixel] = np.arange(len(points), dtype=np.int32)
        slant = np.abs(np.einsum("pi,pi->p", points.geometric_normal, points.to_viewer))
        columns = (
            points.position, 3.0 / np.maximum(slant, 0.1), points.normal, pixels.surface, pixels.albedo,
            pixels.lobe_gain, pixels.normal - points.normal, np.zeros(len(points)),
        )  # fmt: skip
        _captured[pixels] = Captured(row_of_pixel, np.column_stack(columns).astype(np.float32))
    return _captured[pixels]
