"""Rays against a triangle mesh, by Embree. The only module that imports embreex.

Coordinates are centred (records.PatchMesh.centered_vertices). Embree has no near limit here, so every ray that leaves
a surface starts a little off it; `RayScene.offset` says how far, from the float32 spacing of the largest coordinate.
Rays are cut into tiles over a small pool of threads, since embreex releases the interpreter lock while it traces.
Where Embree's packets can be had (packets.py), rays go through it sixteen at a time; the answers are the same.
"""

import os
from collections import deque
from collections.abc import Callable, Iterable
from functools import cache
from itertools import count
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int32

from relight3d.errors import MeshError

NO_HIT = -1
TILE_RAYS = 16_384  # below this a second thread costs more than it brings
NO_LIMITS = np.empty(0, np.float32)
OFFSET_ULPS = 32  # of the largest coordinate: 4 ulps of error from interpolating a point, and room for Embree's own


class Hits(NamedTuple):
    """First hits: face (-1 for none), weights of the face's second and third corner, distance (inf for none)."""

    face: Int32[np.ndarray, " ray"]
    u: Float32[np.ndarray, " ray"]
    v: Float32[np.ndarray, " ray"]
    distance: Float32[np.ndarray, " ray"]


class RayScene:
    """A mesh made ready for rays. Raises MeshError for a mesh that Embree must not see (it does not check).

    `packets` is what compiled loops trace by; None where packets cannot be had.
    """

    def __init__(self, vertices: Float32[np.ndarray, "vertex 3"], faces: Int32[np.ndarray, "face 3"]) -> None:
        if len(faces) == 0:
            raise MeshError("mesh faces", 0, "at least one face")
        if not np.isfinite(vertices).all():
            raise MeshError("mesh vertices", "NaN or infinity", "finite coordinates", "clean the mesh first")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise MeshError("mesh faces", f"index {faces.max()}", f"indices below {len(vertices)}")
        self.num_faces = len(faces)
        self.offset_distance = np.float32(OFFSET_ULPS * np.finfo(np.float32).eps * np.abs(vertices).max())
        self.packets = None if os.environ.get("RELIGHT3D_SINGLE_RAYS") else _packet_scene(vertices, faces)
        self._scene: Any = _single_ray_scene(vertices, faces) if self.packets is None else None

    def offset(
        self, points: Float32[np.ndarray, "ray 3"], geometric_normal: Float32[np.ndarray, "ray 3"]
    ) -> Float32[np.ndarray, "ray 3"]:
        """Points moved off their surface along the unit geometric normal, so that a ray does not meet its own face."""
        return points + geometric_normal * self.offset_distance

    def first_hit(
        self,
        origins: Float32[np.ndarray, "ray 3"],
        directions: Float32[np.ndarray, "ray 3"],
        coherent: bool = False,
    ) -> Hits:
        """The nearest face along each ray; unit directions give distances in the scene's unit.

        `coherent` says that each ray goes nearly the way of the one before, as a camera's do: then it is faster.
        """
        origins, directions = _rays(origins, directions)
        if self.packets is not None:
            return self._first_hit_by_packets(origins, directions, coherent)

        scene = self._scene

        def trace(part: slice) -> dict:
            return scene.run(origins[part], directions[part], output=True)

        parts = _over_tiles(trace, len(origins))
        if not parts:
            empty = np.zeros(0, np.float32)
            return Hits(np.zeros(0, np.int32), empty, empty, empty)
        face, u, v, distance = (np.concatenate([p[key] for p in parts]) for key in ("primID", "u", "v", "tfar"))
        missed = face == NO_HIT
        return Hits(face.astype(np.int32), u, v, np.where(missed, np.inf, distance).astype(np.float32))

    def is_blocked(
        self,
        origins: Float32[np.ndarray, "ray 3"],
        directions: Float32[np.ndarray, "#ray 3"],
        max_distance: Float32[np.ndarray, " ray"] | None = None,
    ) -> Bool[np.ndarray, " ray"]:
        """Whether anything stands along each ray, nearer than `max_distance` (in lengths of the direction).

        One direction (shape 1 3) serves all origins.
        """
        origins, directions = _rays(origins, directions)
        blocked = np.empty(len(origins), dtype=bool)
        limits = NO_LIMITS if max_distance is None else np.ascontiguousarray(max_distance, np.float32)
        shared = len(directions) == 1

        def trace(part: slice) -> None:
            ways = directions if shared else directions[part]
            self.block_tile(origins[part], ways, limits[part], blocked[part], coherent=shared)

        _over_tiles(trace, len(origins))
        return blocked

    def block_tile(
        self,
        origins: Float32[np.ndarray, "ray 3"],
        directions: Float32[np.ndarray, "#ray 3"],
        limits: Float32[np.ndarray, " limit"],
        blocked: Bool[np.ndarray, " ray"],
        coherent: bool = True,
    ) -> None:
        """`is_blocked` for one thread and without copies, written to `blocked`; no `limits` (length 0) is no limit.

        All arrays contiguous. For callers that cut their own tiles, as the relighting engine does.
        """
        if len(origins) == 0:
            return
        if self.packets is not None:
            from relight3d.packets import occluded

            packets = self.packets
            arguments = packets.arguments if coherent else 0
            occluded(packets.occluded, packets.scene, arguments, origins, directions, limits, blocked)
            return
        # `dists` may be overwritten by Embree: it gets a copy.
        far = limits.copy() if len(limits) else None
        blocked[:] = self._scene.run(origins, directions, dists=far, query="OCCLUDED") == 0

    def _first_hit_by_packets(self, origins: np.ndarray, directions: np.ndarray, coherent: bool) -> Hits:
        from relight3d.packets import first_hits

        num, packets = len(directions), self.packets
        assert packets is not None
        hits = Hits(np.empty(num, np.int32), *(np.empty(num, np.float32) for _ in range(3)))

        def trace(part: slice) -> None:
            addresses = (packets.intersect, packets.scene, packets.arguments if coherent else 0)
            first_hits(*addresses, origins[part], directions[part], *(a[part] for a in hits))

        _over_tiles(trace, num)
        return hits


def _single_ray_scene(vertices: np.ndarray, faces: np.ndarray):
    """embreex's own scene."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32))
    # The first query commits the scene; it must not be two threads at once.
    scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
    return scene


def _packet_scene(vertices: np.ndarray, faces: np.ndarray):
    """Packets where they can be had; None without numba or without Embree's own library."""
    try:
        from relight3d.packets import packet_scene
    except ImportError:
        return None
    return packet_scene(vertices, faces)


def num_threads() -> int:
    """Threads used for rays: RELIGHT3D_THREADS, or the cores this process may run on."""
    return max(1, int(os.environ.get("RELIGHT3D_THREADS", "0")) or len(os.sched_getaffinity(0)))


def _serve(jobs: SimpleQueue) -> None:
    while True:
        jobs.get()()


@cache
def _jobs(threads: int, process: int) -> SimpleQueue:
    """What the helping threads wait at: a queue, since an executor's futures cost more than a small tile."""
    jobs: SimpleQueue = SimpleQueue()
    for _ in range(threads):  # one to spare: the last one may still wait for a core
        Thread(target=_serve, args=(jobs,), name="relight3d-rays", daemon=True).start()
    return jobs


class _Job:
    """Parts of one piece of work, taken by whichever thread comes."""

    def __init__(self, work: Callable, parts: list) -> None:
        self.results: list = [None] * len(parts)
        self._work, self._todo = work, deque(enumerate(parts))  # popleft is atomic
        self._ended, self._is_over, self._errors = count(1), Lock(), []  # so is next
        self._is_over.acquire()

    def run(self) -> None:
        while self._todo:
            try:
                index, part = self._todo.popleft()
            except IndexError:
                return
            try:
                if not self._errors:
                    self.results[index] = self._work(part)
            except BaseException as error:  # raised again by who waits
                self._errors.append(error)
            if next(self._ended) == len(self.results):
                self._is_over.release()

    def wait(self) -> list:
        """Until all parts are done; raises what one of them met."""
        self._is_over.acquire()
        # A helper that comes too late may still hold the job, but not what it worked on.
        results, self.results = self.results, []
        del self._work
        if self._errors:
            raise self._errors[0]
        return results


def over_threads(work: Callable, parts: Iterable) -> list:
    """work(part) for each part, in order, on the rays' threads; for work that releases the interpreter lock.

    The caller works too, and does not wait for helpers that have not begun: on a busy machine waking a thread can take
    longer than a frame. So it may be called from such work as well.
    """
    job = _Job(work, list(parts))
    if not job.results:
        return []
    threads = num_threads()
    jobs = _jobs(threads, os.getpid())  # keyed by process, since threads do not survive a fork
    for _ in range(min(threads, len(job.results)) - 1):
        if jobs.qsize() < threads:  # else helpers get no core, and what waits for them would pile up
            jobs.put(job.run)
    job.run()
    return job.wait()


def _over_tiles(work: Callable[[slice], object], num: int) -> list:
    """work(slice) over tiles that cover range(num), in order; several tiles a thread, so that a slow one evens out."""
    if num == 0:
        return []
    threads = num_threads()
    if threads == 1 or num <= TILE_RAYS:
        return [work(slice(0, num))]
    tile = max(TILE_RAYS // 2, -(-num // (4 * threads)))
    return over_threads(work, [slice(i, min(i + tile, num)) for i in range(0, num, tile)])


def _rays(origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """float32, contiguous, and as many directions as origins or just one: embreex reads past the end otherwise."""
    origins = np.ascontiguousarray(origins, np.float32).reshape(-1, 3)
    directions = np.ascontiguousarray(directions, np.float32).reshape(-1, 3)
    assert len(directions) in (1, len(origins)), "one direction, or one per origin"
    return origins, directions
