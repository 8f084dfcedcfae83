"""One capture made worse by degrees, five ways; and the means to do it in little time."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from relight3d.evaluate import disturb
from relight3d.io.capture import read_photograph
from relight3d.records import Capture, Photograph, TriangleMesh

NUM_CLUSTERED = 6  # photographs under clustered lights


def reduced(capture: Capture, factor: int) -> Capture:
    """Photographs averaged over squares of `factor` pixels; what does not fill a square is cut off at the far sides."""

    def smaller(camera):
        width, height = camera.width // factor, camera.height // factor
        cut = replace(camera, width=width * factor, height=height * factor)
        return cut.resized(width, height)

    def shrunk(photograph: Photograph) -> Photograph:
        radiance, is_valid = read_photograph(capture, photograph)
        camera = smaller(photograph.camera)
        rows, columns = camera.height * factor, camera.width * factor
        squares = (camera.height, factor, camera.width, factor)
        pixels = radiance[:rows, :columns].reshape(*squares, 3).mean(axis=(1, 3)).astype(np.float32)
        valid = is_valid[:rows, :columns].reshape(squares).all(axis=(1, 3))
        return replace(photograph, camera=camera, pixels=pixels, is_valid=valid, image_path=None, mask_path=None)

    photographs = tuple(shrunk(p) for p in capture.photographs)
    return replace(capture, camera=smaller(capture.camera), photographs=photographs)


def directions(capture: Capture) -> tuple[list[Photograph], np.ndarray]:
    """The training photographs with a light, and whence it comes, seen from the mesh's middle."""
    lit = [p for p in capture.split("train") if p.lights]
    middle = (capture.mesh.vertices.min(axis=0) + capture.mesh.vertices.max(axis=0)) / 2
    return lit, np.array([p.lights[0].incident(middle[None])[0][0] for p in lit])


def _only(capture: Capture, training: list[Photograph]) -> Capture:
    kept = [p for p in capture.photographs if p.split != "train"]
    return replace(capture, photographs=(*training, *kept))


def _spread(omega: np.ndarray, num: int, among: np.ndarray) -> list[int]:
    """`num` of the lights `among`, each as far as can be from those before it; the first is the middlemost."""
    chosen = [int(among[np.argmax((omega[among] @ omega[among].T).mean(axis=1))])]
    while len(chosen) < min(num, len(among)):
        chosen.append(int(among[np.argmin((omega[among] @ omega[chosen].T).max(axis=1))]))
    return chosen


def with_photographs(capture: Capture, num: float) -> Capture:
    """`num` training photographs, their lights spread as widely as they can be; no lights-off frame."""
    lit, omega = directions(capture)
    return _only(capture, [lit[i] for i in _spread(omega, int(num), np.arange(len(lit)))])


def with_clustered_lights(capture: Capture, radius_deg: float) -> Capture:
    """Photographs whose lights lie within an angle of the middlemost one, spread within it."""
    lit, omega = directions(capture)
    middle = _spread(omega, 1, np.arange(len(lit)))[0]
    near = np.argsort(-omega @ omega[middle], kind="stable")
    inside = near[(omega[near] @ omega[middle]) >= np.cos(np.radians(radius_deg)) - 1e-9]
    return _only(capture, [lit[i] for i in _spread(omega, NUM_CLUSTERED, inside)])


def with_coarse_mesh(capture: Capture, share: float) -> Capture:
    """Vertices merged within cells of this share of the diagonal, unless object or normal's octant differ."""
    return capture if share == 0 else replace(capture, mesh=_clustered(capture.mesh, share))


def _clustered(mesh: TriangleMesh, share: float) -> TriangleMesh:
    low = mesh.vertices.min(axis=0)
    size = share * np.linalg.norm(mesh.vertices.max(axis=0) - low)
    owner = np.zeros(len(mesh.vertices), np.int64)
    if mesh.object_id is not None:
        owner[mesh.faces.ravel()] = np.repeat(mesh.object_id, 3)
    normals = np.zeros_like(mesh.vertices) if mesh.vertex_normals is None else mesh.vertex_normals
    key = np.column_stack([np.floor((mesh.vertices - low) / size), owner, np.round(normals)]).astype(np.int64)
    _, number, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    number = number.ravel()
    vertices = np.stack([np.bincount(number, mesh.vertices[:, i]) / count for i in range(3)], axis=1)
    mean = np.stack([np.bincount(number, normals[:, i]) for i in range(3)], axis=1)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    faces = number[mesh.faces].astype(np.int32)
    keep = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return TriangleMesh(
        vertices,
        faces[keep],
        None if mesh.vertex_normals is None else mean.astype(np.float32),
        object_id=None if mesh.object_id is None else mesh.object_id[keep],
        object_names=mesh.object_names,
    )


CURVES: dict[str, tuple[str, tuple[float, ...], Callable[[Capture, float], Capture]]] = {
    "photographs": ("training photographs", (24, 16, 12, 8, 6, 4, 3, 2, 1), with_photographs),
    "clustering": ("lights within so many degrees (6 photographs)", (90, 60, 45, 30, 20, 12), with_clustered_lights),
    "noise": ("noise, % of white", (0, 0.5, 1, 2, 5, 10, 20), lambda c, x: disturb.with_noise(c, read=x / 100)),
    "misregistration": (
        "mesh beside its place, pixels",
        (0, 0.25, 0.5, 1, 2, 4, 8),
        lambda c, x: disturb.with_misplaced_mesh(c, x, x / 2),
    ),
    "coarseness": (
        "vertices merged within, % of the diagonal",
        (0, 0.25, 0.5, 1, 2, 4),
        lambda c, x: with_coarse_mesh(c, x / 100),
    ),
}
