"""A new viewpoint by compiled loops: the view that views.build_view makes, many times as fast.

The picture is walked in blocks of 4 x 4 pixels, each a packet of rays, in tiles of whole rows of blocks. Mirrors are
followed at once, pixels on outlines are looked at again, and the points are written in the order and in the arrays
that frames read, so that nothing is sorted or packed afterwards.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int32

from relight3d import views
from relight3d.camera import Camera
from relight3d.packets import NUM_HIT_ROWS, WIDTH, empty_packet
from relight3d.records import RelightModel
from relight3d.relight import look_kernels, outline_kernels, view_kernels
from relight3d.relight.captured import captured_of
from relight3d.relight.lazy_view import LazyView, Looked
from relight3d.relight.tiles import tiles
from relight3d.relight.view_arrays import BLOCK, Listed, Mesh, Packed, Picture, Rays
from relight3d.shading import NUDGE_PX
from relight3d.tracing import RayScene, over_threads
from relight3d.views import ViewOptions


class _Tile(NamedTuple):
    """Seats that one thread sees to, and what it found there."""

    seats: slice
    cut: Int32[np.ndarray, " cut"]  # seats of pixels on outlines
    ray_of_cut: Int32[np.ndarray, " cut"]  # where the rays begin that share such a pixel
    counts: tuple[int, int, int]  # points, pixels with points, rays lost to the surroundings
    num_rays: int


def build_fast_view(scene: RayScene, model: RelightModel, camera: Camera, options: ViewOptions) -> LazyView:
    """What a camera other than the captured one sees. The scene must have packets."""
    return _Looker(scene, model, camera, options).view()


class _Looker:
    def __init__(self, scene: RayScene, model: RelightModel, camera: Camera, options: ViewOptions) -> None:
        self.scene, self.model, self.camera, self.options = scene, model, camera, options
        mesh, blocks_wide = model.mesh, -(-camera.width // BLOCK)
        self._mesh = Mesh(
            mesh.faces, mesh.centered_vertices, mesh.vertex_normals, mesh.face_normals, model.surfaces.surface_of_face
        )
        self._captured = captured_of(model)
        self._size = (camera.width, camera.height)
        self._num_seats = blocks_wide * -(-camera.height // BLOCK) * WIDTH
        self._tiles = tiles(self._num_seats, blocks_wide * WIDTH)
        axes = camera.world_from_camera[:3, :3]
        self._right, self._down = np.ascontiguousarray(axes[:, 0]) / camera.fx, -axes[:, 1] / camera.fy
        self._corner = -axes[:, 2] - camera.cx * self._right - camera.cy * self._down
        self._ways = np.stack([self._right, self._down]).astype(np.float32)
        self._reflectance = np.zeros((model.surfaces.num_surfaces, 3), np.float32)
        for mirror in model.mirrors:
            self._reflectance[mirror.surface] = mirror.reflectance
        self._is_mirror = self._reflectance.any(axis=1).astype(np.int32)
        self._has_lens = any((camera.k1, camera.k2, camera.p1, camera.p2))
        # Room for every pixel on an outline.
        num = self._num_seats * (1 + (options.edge_samples if options.edge_samples > 1 else 0))
        self._rays = Rays(
            face=np.empty(num, np.int32),
            label=np.empty(num, np.int32),
            u=np.empty(num, np.float32),
            v=np.empty(num, np.float32),
            depth=np.empty(num, np.float32),
            toward=np.empty((3, num), np.float32),
            normal=np.empty((3, num), np.float32),
            tint=np.empty((num if model.mirrors else 0, 3), np.float32),
            turned=np.empty((num if model.mirrors else 0, 2, 3), np.float32),
        )
        num = camera.num_pixels
        drawn = num if options.edge_samples > 1 else 0
        self._picture = Picture(
            np.empty(num, np.int32), np.empty(drawn, np.float32), np.empty((3, drawn), np.float32),
            np.empty(num, bool), np.empty(drawn, bool),
        )  # fmt: skip

    def view(self) -> LazyView:
        reflected = over_threads(self._look, self._tiles)
        looked = over_threads(self._look_again, self._tiles)
        listed, firsts = self._room_for_list(looked)
        packed = self._pack(looked, firsts, listed)
        num_rays = self.camera.num_pixels + sum(reflected) + sum(tile.num_rays for tile in looked)
        toward = np.ascontiguousarray(self._rays.toward[:, listed.lost].T)
        miss = views._nearest_background(self.model, listed.lost_pixel, toward, self.camera)
        is_hit = self._picture.is_hit.reshape(self.camera.height, self.camera.width)
        parts = Looked(self._mesh, self._captured, self._rays, listed, self._ways)
        return LazyView(self.camera, parts, packed, is_hit, miss, num_rays)

    # ------------------------------------------------------------------------------------- rays

    def _look(self, seats: slice) -> int:
        """Looks through the middle of each pixel. Returns how many rays were reflected."""
        ends, shift = (seats.start, seats.stop), (0.5 + NUDGE_PX[0], 0.5 + NUDGE_PX[1])
        if self._has_lens:
            self._bend(np.arange(*ends, dtype=np.int32), shift[0], shift[1], seats.start)
        rays = (self._corner, self._right, self._down, *shift, self._has_lens, self._rays)
        look_kernels.seat_rays(*ends, *self._size, *rays)
        num = self._trace(*ends)
        with_outlines = self.options.edge_samples > 1
        outline_kernels.draw(*ends, *self._size, with_outlines, self._rays, self._picture)
        return num

    def _bend(self, seats: np.ndarray, shift_x, shift_y, begin: int) -> None:
        """Directions through a lens, for several places of each pixel."""
        camera = self.camera
        block, lane = np.divmod(seats, WIDTH)
        row, column = np.divmod(block, -(-camera.width // BLOCK))
        x, y = BLOCK * column + lane % BLOCK, BLOCK * row + lane // BLOCK
        places = np.stack([x[:, None] + shift_x, y[:, None] + shift_y], axis=-1).reshape(-1, 2)
        self._rays.toward[:, begin : begin + len(places)] = camera.directions(places).T

    def _trace(self, first: int, last: int) -> int:
        packets = self.scene.packets
        assert packets is not None
        eye = (self.camera.center - self.model.mesh.center).astype(np.float32)
        num_reflected = look_kernels.look(
            first, last, packets.intersect, packets.scene, packets.arguments, self.scene.offset_distance, eye,
            self._ways, self.options.max_bounces, self._is_mirror, self._reflectance, self._mesh,
            empty_packet(NUM_HIT_ROWS), self._rays,
        )  # fmt: skip
        look_kernels.write_normals(first, last, self._mesh, self._rays)
        return num_reflected

    def _outline(self, seats: slice) -> Int32[np.ndarray, " cut"]:
        """The seats of pixels on outlines."""
        if self.options.edge_samples == 1:
            return np.empty(0, np.int32)
        picture, cut = self._picture, np.empty(seats.stop - seats.start, np.int32)
        seats_of_row = -(-self.camera.width // BLOCK) * BLOCK
        rows = (seats.start // seats_of_row, min(seats.stop // seats_of_row, self.camera.height))
        outline_kernels.find_edges(*rows, *self._size, picture, np.empty(self.camera.width, bool))
        given = (seats.start, seats.stop, *self._size, picture.is_edge, self._rays.face)
        return cut[: outline_kernels.cut_seats(*given, cut)]

    def _look_again(self, seats: slice) -> _Tile:
        """Looks through several places of the pixels on outlines."""
        cut, samples, num = self._outline(seats), self.options.edge_samples, 0
        # Every seat has room of its own; what is not used never becomes memory.
        begin, ray_of_cut = self._num_seats + samples * seats.start, np.empty(len(cut), np.int32)
        if len(cut):
            side = round(samples**0.5)
            y, x = (np.mgrid[0:side, 0:side].reshape(2, -1) + 0.5) / side
            x, y = x + NUDGE_PX[0], y + NUDGE_PX[1]
            if self._has_lens:
                self._bend(cut, x, y, begin)
            rays = (self._corner, self._right, self._down, x, y, self._has_lens, begin, self._rays)
            look_kernels.cut_rays(cut, self.camera.width, *rays)
            num = len(cut) * samples
            num += self._trace(begin, begin + num)
            left = outline_kernels.keep_met(samples, begin, self._rays.face, cut, ray_of_cut)
            cut, ray_of_cut = cut[:left], ray_of_cut[:left]
        counts = outline_kernels.count_points(seats.start, seats.stop, self._rays.face, cut, ray_of_cut, samples)
        return _Tile(seats, cut, ray_of_cut, counts, num)

    # ------------------------------------------------------------------------------------- points

    def _room_for_list(self, looked: list[_Tile]) -> tuple[Listed, np.ndarray]:
        """Empty lists, and where each tile's begin: its first point, rank and lost ray (and the ends of all)."""
        firsts = np.zeros((len(looked) + 1, 3), np.int64)
        np.cumsum([tile.counts for tile in looked], axis=0, out=firsts[1:])
        points, ranks, lost = firsts[-1]
        listed = Listed(
            np.empty(points, np.int32), np.empty(points, np.float32), np.empty(points, np.float32),
            np.empty(ranks + 1, np.int32), np.empty(ranks, np.int32), np.empty(self.camera.num_pixels, np.int32),
            np.empty(lost, np.int32), np.empty(lost, np.float32), np.empty(lost, np.int32),
        )  # fmt: skip
        listed.start[-1] = points
        return listed, firsts

    def _list(self, tile: _Tile, first: np.ndarray, listed: Listed) -> None:
        given = (tile.seats.start, tile.seats.stop, *self._size, self._rays.face)
        begins = (int(first[0]), int(first[1]), int(first[2]))
        into = (self.options.edge_samples, self.model.outlines_end == "black")
        outline_kernels.list_points(*given, tile.cut, tile.ray_of_cut, *into, *begins, listed)

    def _pack(self, looked: list[_Tile], firsts: np.ndarray, listed: Listed) -> Packed:
        """What frames read of the points."""
        model, num = self.model, len(listed.ray)
        with_corners = model.indirect is not None and model.indirect.site == "vertex"
        num_corners, num_sources = num if with_corners else 0, num if model.residual is not None else 0
        is_read = np.zeros(len(model.mesh.vertices) if with_corners else 0, np.uint8)
        row_of_vertex, vertex = np.empty(len(is_read), np.int32), np.empty(len(is_read), np.int32)
        packed = Packed(
            position=np.empty((3, num), np.float32),
            geometric=np.empty((3, num), np.float32),
            normal=np.empty((3, num), np.float32),
            to_viewer=np.empty((3, num), np.float32),
            diffuse=np.empty((3, num), np.float32),
            gloss=np.empty((3, num), np.float32),
            surface=np.empty(num, np.int32),
            neighbour=np.empty((num, 4), np.int32),
            corner=np.empty((num_corners, 3), np.int32),
            corner_share=np.empty((num_corners, 3), np.float32),
            vertex=vertex,
            source=np.empty((num_sources, 4), np.int32),
            source_share=np.empty((num_sources, 4), np.float32),
        )
        given = (listed, self._rays, self._mesh, self._captured, packed, is_read)

        def fill(k: int) -> None:
            self._list(looked[k], firsts[k], listed)
            view_kernels.fill_points(int(firsts[k, 0]), int(firsts[k + 1, 0]), *given, view_kernels.scratch())

        over_threads(fill, range(len(looked)))
        num_read = view_kernels.number_read(is_read, row_of_vertex, vertex)
        corner, points = packed.corner.reshape(-1), (self._picture.label, listed.point_of_pixel)

        def tie(k: int) -> None:
            seats, first, last = looked[k].seats, int(firsts[k, 0]), int(firsts[k + 1, 0])
            outline_kernels.find_neighbours(
                seats.start, seats.stop, *self._size, first, last, *points, packed.neighbour
            )
            view_kernels.renumber(row_of_vertex, corner[3 * first : 3 * last])

        over_threads(tie, range(len(looked)))
        return packed._replace(vertex=vertex[:num_read])
