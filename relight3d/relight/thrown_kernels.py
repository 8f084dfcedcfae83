"""The light that mirrors throw in one compiled call: rays to the mirror, what they met, and rays on to the lamp."""

import numba
import numpy as np

from relight3d.packets import (
    DIRECTION,
    FAR,
    HIT_PRIMITIVE,
    NEVER,
    NUM_HIT_ROWS,
    NUM_RAY_ROWS,
    ORIGIN,
    WIDTH,
    call_query,
    empty_packet,
)
from relight3d.relight.kernels import AT_INFINITY, FULL, KIND, incident, inlined, take
from relight3d.relight.ray_kernels import ask_thrown

ENOUGH = 1e-3  # of the way to the mirror: how far off it a ray may meet it (shading.cast_thrown)


@inlined
def _leave_mirror(real, front, offset, crossings, index, start, count, rays):
    """Rays on to the lamp from `count` crossings of `index`; the last one again in the lanes that are left."""
    for lane in range(WIDTH):
        ray = index[start + min(lane, count - 1)]
        x, y, z = crossings[ray, 0] + front[0], crossings[ray, 1] + front[1], crossings[ray, 2] + front[2]
        rays[ORIGIN, lane], rays[ORIGIN + 1, lane], rays[ORIGIN + 2, lane] = x, y, z
        lx, ly, lz, _, distance = incident(real, 0, x, y, z)
        rays[DIRECTION, lane], rays[DIRECTION + 1, lane], rays[DIRECTION + 2, lane] = lx, ly, lz
        rays[FAR, lane] = NEVER if real[0, KIND] == AT_INFINITY else distance - 2 * offset


@numba.njit(nogil=True, cache=True, error_model="numpy")
def cast_thrown(
    counter, size, packets, virtual, real, ground, plane, front, position, geometric, normal, offset, surface_of_face,
    surface, seen,
):  # fmt: skip
    """shading.cast_thrown of tiles of `size` points, as long as there are any: FULL in `seen`. Returns the number of rays.

    `packets`: the addresses of both queries, of the scene and of their arguments. `plane`: the mirror's point, normal and
    radius; `surface` its number; `front` from the mirror to a little before it.
    """
    intersect, occluded, scene, arguments = packets
    hit_words, hit_rays, active = empty_packet(NUM_HIT_ROWS)
    words, rays, _ = empty_packet(NUM_RAY_ROWS)
    num, total = position.shape[1], 0
    is_near, index, through = np.empty(num, np.bool_), np.empty(size, np.int32), np.empty(size, np.int32)
    origins, ways, crossings = (
        np.empty((size, 3), np.float32),
        np.empty((size, 3), np.float32),
        np.empty((size, 3), np.float32),
    )
    reach = np.empty(size, np.float32)
    while True:
        first = take(counter) * size  # pyright: ignore[reportCallIssue]
        if first >= num:
            return total
        last = min(first + size, num)
        part = (position[:, first:last], geometric[:, first:last], normal[:, first:last])
        asked = ask_thrown(
            virtual, real, ground, plane, part[0], part[1], part[2], offset, 0, last - first, is_near, origins, ways, reach,
            crossings, index,
        )  # fmt: skip
        total += asked
        num_through = 0
        for start in range(0, asked, WIDTH):
            count = min(WIDTH, asked - start)
            for lane in range(WIDTH):
                ray = start + min(lane, count - 1)
                for axis in range(3):
                    hit_rays[ORIGIN + axis, lane], hit_rays[DIRECTION + axis, lane] = (
                        origins[ray, axis],
                        ways[ray, axis],
                    )
                hit_rays[FAR, lane], active[lane] = NEVER, -1 if lane < count else 0
            hit_words[NUM_RAY_ROWS:] = -1
            call_query(intersect, active.ctypes.data, scene, hit_words.ctypes.data, arguments)  # pyright: ignore[reportCallIssue]
            for lane in range(count):
                face, way = hit_words[HIT_PRIMITIVE, lane], reach[start + lane]
                meets = face >= 0 and surface_of_face[max(face, 0)] == surface
                through[num_through] = start + lane
                num_through += meets and abs(hit_rays[FAR, lane] - way) <= np.float32(ENOUGH) * way + 16 * offset
        total += num_through
        for start in range(0, num_through, WIDTH):
            count = min(WIDTH, num_through - start)
            _leave_mirror(real, front, offset, crossings, through, start, count, rays)
            for lane in range(WIDTH):
                active[lane] = -1 if lane < count else 0
            call_query(occluded, active.ctypes.data, scene, words.ctypes.data, arguments)  # pyright: ignore[reportCallIssue]
            for lane in range(count):
                if rays[FAR, lane] >= 0:
                    seen[first + index[through[start + lane]]] = FULL
