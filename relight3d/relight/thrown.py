"""The light that plane mirrors throw: which points get it, by a ray to the mirror and one on to the lamp."""

import numpy as np
from jaxtyping import Float32, UInt8

from relight3d.lights import Light
from relight3d.records import RelightModel
from relight3d.relight import ray_kernels, thrown_kernels
from relight3d.relight.ground import ground_of
from relight3d.relight.kernels import AT_INFINITY, FULL, KIND, PLACE
from relight3d.relight.light_rows import light_row
from relight3d.relight.tiles import counting, tiles
from relight3d.tracing import RayScene, over_threads

TILE = 2048  # points that a thread takes at once
Planes = Float32[np.ndarray, "3 point"]


class Thrown:
    """shading.cast_thrown for one set of points."""

    def __init__(
        self, scene: RayScene, model: RelightModel, position: Planes, geometric: Planes, normal: Planes
    ) -> None:
        self._scene, self._model, self._planes = scene, model, (position, geometric, normal)
        self._offset, self._ground = np.float32(scene.offset_distance), ground_of(model.mesh)

    def cast(
        self, light: Light, virtual: Float32[np.ndarray, "1 row"], mirror_index: int
    ) -> tuple[UInt8[np.ndarray, " point"], int]:
        """FULL for points that get the light by way of the mirror, as if from `virtual` behind it; the number of rays."""
        mirror, offset, num = self._model.mirrors[mirror_index], self._offset, self._planes[0].shape[1]
        seen, real = np.zeros(num, np.uint8), light_row(light)[None]
        at_infinity = real[0, KIND] == AT_INFINITY
        if at_infinity and virtual[0, PLACE : PLACE + 3] @ mirror.normal >= 0:  # the light is behind the mirror
            return seen, 0
        plane = np.array([*mirror.point, *mirror.normal, mirror.radius * 1.001], np.float32)
        front = (mirror.normal * (4 * offset)).astype(np.float32)
        surface_of_face, packets = self._model.surfaces.surface_of_face, self._scene.packets
        if packets is not None:
            addresses = (packets.intersect, packets.occluded, packets.scene, packets.arguments)
            given = (addresses, virtual, real, self._ground, plane, front, *self._planes, offset, surface_of_face)
            cast = thrown_kernels.cast_thrown
            return seen, sum(counting(lambda counter: cast(counter, TILE, *given, mirror.surface, seen)))

        triple = [np.empty((num, 3), np.float32) for _ in range(3)]
        rays = (triple[0], triple[1], np.empty(num, np.float32), triple[2], np.empty(num, np.int32))
        is_near, index = np.empty(num, bool), rays[-1]

        def cast_part(part: slice) -> int:
            given = (virtual, real, self._ground, plane, *self._planes, offset, part.start, part.stop)
            num = ray_kernels.ask_thrown(*given, is_near, *rays)
            if num == 0:
                return 0
            asked = slice(part.start, part.start + num)
            origins, ways, reach, crossings = (each[asked] for each in rays[:-1])
            hits = self._scene.first_hit(origins, ways, coherent=True)
            through = surface_of_face[np.maximum(hits.face, 0)] == mirror.surface
            through &= (hits.face >= 0) & (np.abs(hits.distance - reach) <= 1e-3 * reach + 16 * offset)
            bounce = crossings[through] + front
            if len(bounce) == 0:
                return num
            onward, _, left = light.incident(bounce)
            limit = None if at_infinity else left - 2 * offset
            blocked = self._scene.is_blocked(bounce, onward[:1] if at_infinity else onward, limit)
            seen[index[asked][through][~blocked]] = FULL
            return num + len(bounce)

        return seen, sum(over_threads(cast_part, tiles(num)))
