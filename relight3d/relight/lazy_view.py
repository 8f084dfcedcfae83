"""A view of which only what frames read is there; the rest is told when somebody asks for it."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int32

from relight3d.camera import Camera
from relight3d.records import RelightModel, ShadingPoints
from relight3d.relight import view_kernels
from relight3d.relight.tiles import tiles
from relight3d.relight.view_arrays import Captured, Listed, Mesh, Packed, Rays, Told
from relight3d.tracing import over_threads
from relight3d.views import View


class Looked(NamedTuple):
    """What a view was made of."""

    mesh: Mesh
    captured: Captured
    rays: Rays
    listed: Listed
    ways: Float32[np.ndarray, "2 3"]  # the camera's steps to the right and down for one pixel at depth 1


class LazyView(View):
    """A View made by compiled loops: `packed` is there, and its other arrays are made at the first question for them.

    Frames ask for none of them; the reference, the plan and a lattice of shadows do.
    """

    looked: Looked
    packed: Packed

    def __init__(
        self,
        camera: Camera,
        looked: Looked,
        packed: Packed,
        is_hit: Bool[np.ndarray, "height width"],
        miss_source: Int32[np.ndarray, " miss"],
        num_rays: int,
    ) -> None:
        listed = looked.listed
        self._set(camera=camera, looked=looked, packed=packed, is_hit=is_hit, num_rays=num_rays)
        self._set(miss_pixel=listed.lost_pixel, miss_source=miss_source, miss_throughput=listed.lost_part)
        self._set(surface=packed.surface, normal=packed.normal.T, neighbour=packed.neighbour)

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)  # a View is frozen

    def __getattr__(self, name: str) -> Any:
        """Only called for what is not there yet."""
        if name == "step":
            self._set(step=self.steps(np.arange(len(self.packed.surface), dtype=np.int32)))
        elif name in ("points", "albedo", "lobe_gain", "throughput", "is_mirrored", "source", "share"):
            self._tell()
        else:
            raise AttributeError(name)
        return self.__dict__[name]

    def serves(self, model: RelightModel) -> bool:
        """Whether `packed` has all that frames of the model read."""
        indirect, packed = model.indirect, self.packed
        has_sites = indirect is None or (indirect.site == "vertex" and len(packed.corner) == len(packed.surface))
        return has_sites and (model.residual is None or len(packed.source) == len(packed.surface))

    def steps(self, index: Int32[np.ndarray, " some"]) -> Float32[np.ndarray, "some 2 3"]:
        """View.step of some points."""
        looked, packed, out = self.looked, self.packed, np.empty((len(index), 2, 3), np.float32)
        given = (looked.ways, looked.listed.ray, looked.rays, packed.geometric, packed.to_viewer)
        view_kernels.steps(index, *given, out)
        return out

    def _tell(self) -> None:
        looked, packed, num = self.looked, self.packed, len(self.packed.surface)
        triple, single = (lambda: np.empty((num, 3), np.float32)), (lambda: np.empty(num, np.float32))
        told = Told(
            np.empty(num, np.int32), triple(), triple(), single(), triple(), single(), triple(), np.empty(num, bool),
            np.empty((num, 4), np.int32), np.empty((num, 4), np.float32),
        )  # fmt: skip
        # The corners are written and numbered already.
        given = (looked.listed, looked.rays, looked.mesh, looked.captured, packed._replace(corner=packed.corner[:0]))
        is_read = np.zeros(0, np.uint8)

        def tell(part: slice) -> None:
            view_kernels.tell_points(part.start, part.stop, *given, is_read, told, view_kernels.scratch())

        over_threads(tell, tiles(num))
        pixel = np.repeat(looked.listed.pixel_of_rank, np.diff(looked.listed.start))
        points = ShadingPoints(
            pixel, told.face, told.barycentric, packed.position.T, packed.geometric.T, told.normal,
            packed.to_viewer.T, told.depth,
        )  # fmt: skip
        names = ("albedo", "lobe_gain", "throughput", "is_mirrored", "source", "share")
        self._set(points=points, **{name: getattr(told, name) for name in names})
