"""How far each point of a view sees each light: traced, or traced on a lattice."""

import numpy as np
from jaxtyping import Float32, Int64, UInt8

from relight3d.lights import Light
from relight3d.records import RelightModel
from relight3d.relight import ray_kernels
from relight3d.relight.anchors import Anchors
from relight3d.relight.borders import Borders, Pairs
from relight3d.relight.buffers import Buffers
from relight3d.relight.cast_kernels import cast_tiles, find_in_tiles
from relight3d.relight.casting import cast_listed
from relight3d.relight.ground import ground_of
from relight3d.relight.kept_answers import KeptAnswers
from relight3d.relight.kernels import FULL
from relight3d.relight.lattice import Lattice
from relight3d.relight.light_rows import geometry_key, light_row
from relight3d.relight.options import RelightOptions
from relight3d.relight.thrown import Thrown
from relight3d.relight.tiles import counters, counting, tiles
from relight3d.tracing import RayScene, over_threads

TILE = 2048  # points of a tile of rays
Seen = UInt8[np.ndarray, " point"]


class Shadows(KeptAnswers[Seen]):
    """The shadow rays of one view, and the last lights' answers: a light that did not move casts none.

    `rays` counts those of the lights asked for since `start_frame`.
    """

    def __init__(
        self,
        scene: RayScene,
        model: RelightModel,
        buffers: Buffers,
        options: RelightOptions,
        anchors: Anchors | None = None,
    ) -> None:
        super().__init__(options.keep_lights)
        self._scene, self._buffers, self._options = scene, buffers, options
        num = len(buffers)
        self._offset = np.float32(scene.offset_distance)
        self._ground = ground_of(model.mesh)
        self._tiles = tiles(num)
        self._index, self._state = np.empty(num, np.int32), np.zeros(num, np.uint8)
        self._thrown = Thrown(scene, model, buffers.position, buffers.geometric_normal, buffers.normal)
        self._borders = Borders(scene, buffers)
        self._lattice = None if anchors is None else Lattice(scene, buffers, anchors, self._ground, self._borders)

    def seen(self, light: Light, effect: str = "shadow") -> Seen:
        """How far each point sees the light, of FULL; 0 where it is turned away. Rays are counted as `effect`."""
        return self.keep((geometry_key(light),), lambda: self._cast(light_row(light)[None], effect))

    def thrown(self, light: Light, virtual: Float32[np.ndarray, " row"], mirror_index: int) -> Seen:
        """Which points get the light by way of a mirror, as if from a `virtual` light behind it."""
        key = (geometry_key(light), mirror_index)
        return self.keep(key, lambda: self._cast_thrown(light, virtual[None], mirror_index))

    # ------------------------------------------------------------------------------------- one light

    def _cast(self, light: Float32[np.ndarray, "1 row"], effect: str) -> Seen:
        seen, shadows = np.zeros(len(self._buffers), np.uint8), self._options.shadows
        if shadows == "off":
            over_threads(lambda part: self._unshadowed(light, part, seen), self._tiles)
            return seen
        if self._lattice is not None:
            num, num_border = self._lattice.cast(light, seen, self._options.borders)
            self.rays[effect] = self.rays.get(effect, 0) + num
            self.rays["border"] += num_border
            return seen
        num = sum(self._cast_all(light, seen))
        self.rays[effect] = self.rays.get(effect, 0) + num
        if self._options.borders:
            self.rays["border"] += self._borders.cast(light, self._find_borders, counters(), seen)
        return seen

    def _face(self, light: np.ndarray, part: slice) -> None:
        b = self._buffers
        geometry = (b.position, b.geometric_normal, b.normal)
        ray_kernels.face_light(light, self._ground, *geometry, part.start, part.stop, self._state)

    def _unshadowed(self, light: np.ndarray, part: slice, seen: Seen) -> None:
        self._face(light, part)
        seen[part][self._state[part] == ray_kernels.ASKS] = FULL

    def _cast_all(self, light: np.ndarray, seen: Seen) -> list[int]:
        """A ray from each point that asks for one; how many, by thread."""
        packets, b = self._scene.packets, self._buffers
        if packets is None:
            return over_threads(lambda part: self._cast_tile(light, part, seen), self._tiles)
        addresses = (packets.occluded, packets.scene, packets.arguments)
        given = (addresses, light, self._ground, b.position, b.geometric_normal, b.normal, self._offset)
        return counting(lambda counter: cast_tiles(counter, TILE, *given, self._state, seen))

    def _cast_tile(self, light: np.ndarray, part: slice, seen: Seen) -> int:
        self._face(light, part)
        index, b = self._index[part], self._buffers
        index = index[: ray_kernels.gather(part.start, part.stop, self._state, index)]
        return cast_listed(self._scene, light, b.position, b.geometric_normal, index, self._state, seen)

    def _find_borders(self, counter: Int64[np.ndarray, "1"]) -> Pairs:
        pairs = np.empty((2 * len(self._buffers) + 1, 3), np.int32)
        return pairs[: find_in_tiles(counter, TILE, self._buffers.neighbour, self._state, pairs)]

    # ------------------------------------------------------------------------------------- mirrors

    def _cast_thrown(self, light: Light, virtual: Float32[np.ndarray, "1 row"], mirror_index: int) -> Seen:
        seen, num = self._thrown.cast(light, virtual, mirror_index)
        self.rays["thrown"] += num
        return seen
