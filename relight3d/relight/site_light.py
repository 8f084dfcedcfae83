"""Indirect light of a view's sites under some lights: which compiled loop evaluates it, and with what."""

from typing import Any

import numpy as np
from jaxtyping import Float32, Float64

from relight3d.lights import DirectionalLight, Light
from relight3d.maths.light_basis import evaluate_basis, within_reach
from relight3d.records import Indirect
from relight3d.relight import kernels
from relight3d.relight.buffers import Sites
from relight3d.relight.indirect_kernels import far_functions, far_irradiance, site_irradiance
from relight3d.relight.light_rows import light_row
from relight3d.relight.tiles import counting, tiles
from relight3d.tracing import over_threads

MIN_SITES = 8192  # fewer are not worth a second thread
SITES_AT_ONCE = 1024


class SiteLight:
    """One view's indirect light; always asked for with the same sites."""

    def __init__(self, indirect: Indirect) -> None:
        self._indirect = indirect
        self._planes: list[Any] = []  # the sites' coefficients, basis x 3 x site, and ambient light, 3 x site

    def irradiance(self, sites: Sites, lights: list[Light]) -> Float32[np.ndarray, "site 4"]:
        """Indirect and ambient light at the sites under all lights; the fourth column only fills the row."""
        indirect = self._indirect
        far_lights = [light for light in lights if isinstance(light, DirectionalLight)]
        if sites.to_basis is not None and len(far_lights) == len(lights) and self._has_planes(sites):
            return self._far_irradiance(sites.to_basis, far_lights)
        far, ambient = np.zeros((sites.coefficients.shape[1], 3), np.float32), sites.ambient
        ways, colors, places, powers = [], [], [], []
        for light in lights:
            at_infinity = isinstance(light, DirectionalLight)
            if sites.to_basis is None:
                if at_infinity:
                    direction, _ = within_reach(np.array([light.to_light]), indirect.anchors, indirect.reach_rad)
                    far += evaluate_basis(indirect.basis, direction)[0][:, None] * light.power
                else:
                    ambient = ambient + self._without_polynomial(light, sites)
            elif at_infinity:
                ways.append(light.to_light)
                colors.append(light.power)
            else:
                places.append(light.position)
                powers.append(light.power * self._part(light, sites))
        polynomial = sites.to_basis if sites.to_basis is not None else np.zeros((0, 20))
        out = np.empty((len(ambient), 4), np.float32)  # the fourth column only fills the row
        given = (_triples(ways), _triples(colors), _triples(places), _triples(powers))
        reach = (np.ascontiguousarray(indirect.anchors), float(np.cos(indirect.reach_rad)), np.sin(indirect.reach_rad))

        def evaluate(part: slice) -> None:
            site_irradiance(
                part.start, part.stop, sites.coefficients, ambient, far.copy(), *given, *reach,
                indirect.softening, sites.positions, polynomial, np.empty_like(far), np.empty(20), out,
            )  # fmt: skip

        over_threads(evaluate, tiles(len(out), MIN_SITES))
        return out

    def _has_planes(self, sites: Sites) -> bool:
        """Whether the sites stand in planes: from the second frame on, since a view that moves has but one."""
        if not self._planes:
            self._planes = [None]
        elif self._planes[0] is None:
            self._planes = [
                np.ascontiguousarray(sites.coefficients.transpose(1, 2, 0)),
                np.ascontiguousarray(sites.ambient.T),
            ]
        return self._planes[0] is not None

    def _far_irradiance(self, to_basis: np.ndarray, lights: list[DirectionalLight]) -> Float32[np.ndarray, "site 4"]:
        """The same for lights at infinity alone, in vector registers."""
        indirect = self._indirect
        rows, out = np.zeros((len(to_basis), 3), np.float32), np.empty((self._planes[1].shape[1], 4), np.float32)
        ways, colors = _triples([light.to_light for light in lights]), _triples([light.power for light in lights])
        reach = (np.ascontiguousarray(indirect.anchors), float(np.cos(indirect.reach_rad)), np.sin(indirect.reach_rad))
        far_functions(ways, colors, *reach, to_basis, np.empty(20), rows)

        def evaluate(counter: np.ndarray) -> None:
            work = np.empty(SITES_AT_ONCE, np.float32)
            far_irradiance(counter, SITES_AT_ONCE, self._planes[0], self._planes[1], rows, work, out)

        counting(evaluate)
        return out

    @staticmethod
    def _part(light: Light, sites: Sites) -> float:
        """The part of the scene that a spot lights, shading.light_strength; 1 for lamps without a cone."""
        if light_row(light)[kernels.CONE_POWER] == 0:
            return 1.0
        to_light = light.incident(sites.all_positions.astype(np.float64)).to_light
        return float(np.mean(light.cone(to_light)))  # type: ignore[union-attr]

    def _without_polynomial(self, light: Light, sites: Sites) -> Float32[np.ndarray, "site 3"]:
        indirect = self._indirect
        to_light, _, distance = light.incident(sites.positions.astype(np.float64))
        direction, _ = within_reach(to_light, indirect.anchors, indirect.reach_rad)
        strength = self._part(light, sites) / np.maximum(distance, indirect.softening) ** 2
        rows = evaluate_basis(indirect.basis, direction) * strength[:, None]
        return (np.einsum("nbc,nb->nc", sites.coefficients, rows) * light.power).astype(np.float32)


def _triples(rows: list) -> Float64[np.ndarray, "row 3"]:
    return np.array(rows, np.float64).reshape(-1, 3)
