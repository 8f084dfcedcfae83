"""What every new viewpoint of a model reads of its captured pixels, made once."""

from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float32

from relight3d.records import PixelMap, RelightModel
from relight3d.relight.captured_kernels import ALIKE
from relight3d.relight.view_arrays import MARGIN, NUM_CELL_COLUMNS, NUM_COLUMNS, SURFACE, Captured

_captured: "WeakKeyDictionary[PixelMap, Captured]" = WeakKeyDictionary()


def captured_of(model: RelightModel) -> Captured:
    """Kept as long as the model's pixels are."""
    if model.pixels not in _captured:
        _captured[model.pixels] = _made(model)
    # Two models may share their pixels, but not this.
    return _captured[model.pixels]._replace(vertex_albedo=model.albedo_unseen)


def _made(model: RelightModel) -> Captured:
    camera, pixels, points = model.camera, model.pixels, model.pixels.points
    y, x = np.divmod(points.pixel, camera.width)
    row_of_pixel = np.full((camera.height + 2 * MARGIN, camera.width + 2 * MARGIN), len(points), np.int32)
    row_of_pixel[y + MARGIN, x + MARGIN] = np.arange(len(points), dtype=np.int32)
    slant = np.abs(np.einsum("pi,pi->p", points.geometric_normal, points.to_viewer))
    eye = camera.center - model.mesh.center
    distance = np.linalg.norm(points.position - eye, axis=1)
    columns = (
        points.position, 3.0 / np.maximum(slant, 0.1), points.normal, pixels.surface, pixels.albedo,
        pixels.lobe_gain, pixels.normal - points.normal, 1.0 / np.maximum(distance, 1e-30),
    )  # fmt: skip
    seen = np.zeros((len(points) + 1, NUM_COLUMNS), np.float32)
    seen[:-1], seen[-1, SURFACE] = np.column_stack(columns), -1.0
    return Captured(
        row_of_pixel.reshape(-1),
        seen.reshape(-1),
        _cells(row_of_pixel, seen).reshape(-1),
        np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.k1, camera.k2, camera.p1, camera.p2]),
        np.ascontiguousarray(camera.world_from_camera[:3, :3]),
        eye,
        np.array([camera.width, camera.height], np.int32),
        model.albedo_unseen,
    )


def _cells(row_of_pixel: np.ndarray, seen: np.ndarray) -> Float32[np.ndarray, "row column 4"]:
    """What four neighbouring pixels have in common, by the upper left one (view_arrays.CELL_SURFACE and on)."""
    cells = np.zeros((*row_of_pixel.shape, NUM_CELL_COLUMNS), np.float32)
    cells[..., 0] = -1.0
    four = np.stack([row_of_pixel[:-1, :-1], row_of_pixel[:-1, 1:], row_of_pixel[1:, :-1], row_of_pixel[1:, 1:]])
    place, reach, normal, surface = seen[four, :3], seen[four, 3], seen[four, 4:7], seen[four, 7]
    radius = np.linalg.norm(place - place[0], axis=-1).max(axis=0)
    spread = np.arccos(np.clip(np.einsum("kyxi,yxi->kyx", normal, normal[0]), -1.0, 1.0)).max(axis=0)
    # A normal within this angle of the first is alike to all four; a little less, for float32's sake. So are the others.
    angle = np.arccos(float(ALIKE)) - 1e-3 - spread
    is_one = (surface == surface[0]).all(axis=0) & (angle > 0)
    common = np.stack([surface[0], 1.001 * radius, 0.999 * reach.min(axis=0), np.cos(np.maximum(angle, 0.0))], axis=-1)
    cells[:-1, :-1] = np.where(is_one[..., None], common, cells[:-1, :-1])
    return cells
