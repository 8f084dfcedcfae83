"""Frames with fewer evaluations than pixels: an engine whose slow terms are evaluated at anchors."""

import numpy as np

from relight3d.records import RelightModel
from relight3d.relight import fill_kernels, pixel_kernels
from relight3d.relight.anchors import CELL, Anchors
from relight3d.relight.buffers import Buffers, Sites
from relight3d.relight.engine import Engine, scratch
from relight3d.relight.highlights import bright_lobes
from relight3d.relight.options import RelightOptions
from relight3d.relight.tiles import counting
from relight3d.tracing import RayScene
from relight3d.views import View


class FillEngine(Engine):
    """One view of a model, its indirect light at anchors only, faint highlights left out."""

    def __init__(self, scene: RayScene, model: RelightModel, view: View, options: RelightOptions) -> None:
        super().__init__(scene, model, view, options)
        a = self.anchors
        if a is None or options.lattice_px != CELL:
            a = self._anchors(CELL)
        self._blend: tuple[np.ndarray, np.ndarray] | None = None
        if self.sites is not None:
            at = (self.sites.source[a.point], self.sites.share[a.point])
            if len(a.point) < len(self.sites.positions):
                self.sites = anchor_sites(a, self.sites, self.buffers)
            else:  # fewer sites than anchors: these read those
                self._blend = at
        self.num_readings = 4 * (len(a.cell) + len(a.loose)) + (0 if self._blend is None else self._blend[0].size)
        starts = self.buffers.point_start
        starts = np.append(starts[: -1 : pixel_kernels.CHUNK], starts[-1])  # the first point of each chunk
        cell_start, loose_start = (np.searchsorted(points, starts).astype(np.int32) for points in (a.cell, a.loose))
        self._cells = (cell_start, a.cell, a.cell_corner)
        self._loose = (loose_start, a.loose, a.corner, a.share)
        # The most that a lobe can be multiplied by at any point, power and falloff aside.
        self._most_gloss = float(self.buffers.gloss.max(initial=0.0))

    def _shade(self, rows, seen, weights, irradiance, out) -> None:
        b, residual, flat = self.buffers, self._residual(weights), out.reshape(-1)
        if self._blend is not None:
            at_anchors = np.empty((len(self._blend[0]), 4), np.float32)
            fill_kernels.blend(*self._blend, irradiance, at_anchors)
            irradiance = at_anchors
        lobes = bright_lobes(b.lobes, rows, self._most_gloss * self.model.exposure, self.model.mesh.radius)
        points = (b.position, b.normal, b.to_viewer, b.tangent, b.diffuse, b.gloss, b.surface, b.lobe_start, lobes)

        def fill(counter: np.ndarray) -> None:
            fill_kernels.fill(
                counter, b.point_start, b.pixel_of_rank, self._cells, self._loose, rows, seen, *points,
                irradiance, *residual,
                np.empty((fill_kernels.NUM_FILL_ROWS, self._chunk_points), np.float32), scratch(), flat,
            )  # fmt: skip

        counting(fill)


def anchor_sites(anchors: Anchors, sites: Sites, buffers: Buffers) -> Sites:
    """Indirect light kept at the anchors themselves, blended there from the sites that they read."""
    at = anchors.point
    source, share = sites.source[at], sites.share[at]
    each = np.arange(len(at), dtype=np.int32)[:, None]
    return Sites(
        source=each,
        share=np.ones((len(at), 1), np.float32),
        positions=np.ascontiguousarray(buffers.position[:, at].T),
        coefficients=np.einsum("ak,akbc->abc", share, sites.coefficients[source]),
        ambient=np.einsum("ak,akc->ac", share, sites.ambient[source]),
        all_positions=sites.all_positions,
        to_basis=sites.to_basis,
    )
