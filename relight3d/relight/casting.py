"""Shadow rays of listed points: in one compiled call, or in steps where Embree's packets cannot be had."""

import numpy as np
from jaxtyping import Float32, Int32, UInt8

from relight3d.maths.pixel_parts import HALVINGS, PLACES
from relight3d.relight import cast_kernels, ray_kernels
from relight3d.relight.kernels import AT_INFINITY, KIND
from relight3d.tracing import NO_LIMITS, RayScene


def cast_listed(
    scene: RayScene,
    light: Float32[np.ndarray, "1 row"],
    position: Float32[np.ndarray, "3 point"],
    geometric: Float32[np.ndarray, "3 point"],
    index: Int32[np.ndarray, " ray"],
    state: UInt8[np.ndarray, " point"],
    seen: UInt8[np.ndarray, " point"],
) -> int:
    """A ray to the light from each point of `index`; what it found stands in `state` and `seen`. Returns how many."""
    packets, offset = scene.packets, np.float32(scene.offset_distance)
    if packets is not None:
        addresses = (packets.occluded, packets.scene, packets.arguments)
        cast_kernels.cast_listed(addresses, light, position, geometric, offset, index, state, seen)
        return len(index)
    rays, blocked = room(len(index)), np.empty(len(index), bool)
    ray_kernels.rays_to_light(light, position, geometric, offset, index, *rays)
    block(scene, light, *rays, blocked)
    ray_kernels.settle(index, blocked, state, seen)
    return len(index)


def place_borders(
    scene: RayScene,
    light: Float32[np.ndarray, "1 row"],
    position: Float32[np.ndarray, "3 point"],
    geometric: Float32[np.ndarray, "3 point"],
    step: Float32[np.ndarray, "pair 2 3"],
    pairs: Int32[np.ndarray, "pair 3"],
) -> Int32[np.ndarray, " pair"]:
    """Where the shadow's edge runs between the two points of each pair (forward.border_fractions)."""
    packets, place = scene.packets, np.zeros(len(pairs), np.int32)
    given = (light, position, geometric, step, np.float32(scene.offset_distance), pairs, place)
    if packets is not None:
        cast_kernels.place_borders((packets.occluded, packets.scene, packets.arguments), *given)
        return place
    rays, blocked = room(len(pairs)), np.empty(len(pairs), bool)
    for k in range(HALVINGS):
        half = PLACES >> (k + 1)
        ray_kernels.ask_borders(*given, half, *rays)
        block(scene, light, *rays, blocked)
        ray_kernels.narrow_borders(blocked, half, place)
    return place


def block(scene: RayScene, light: np.ndarray, origins, ways, limits, blocked) -> None:
    """Whether anything stands along rays to the light; one at infinity has one direction and no limits."""
    if light[0, KIND] == AT_INFINITY:
        ways, limits = light[:, 1:4], NO_LIMITS
    scene.block_tile(origins, ways, limits, blocked)


def room(num: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For so many rays: origins, directions, limits."""
    return np.empty((num, 3), np.float32), np.empty((num, 3), np.float32), np.empty(num, np.float32)
