"""Frames at half resolution, readably: what the compiled passes do, from the reference's own rays and terms."""

from typing import NamedTuple

import numpy as np

from relight3d.forward import background_radiance, dark_residual, irradiance_at_points, residual_source
from relight3d.lights import FAR, Light
from relight3d.maths.lafortune import tangent_frame
from relight3d.maths.pixel_parts import HALVINGS, PLACES
from relight3d.relight.half_engine import HalfEngine
from relight3d.relight.half_lattice import SPACING
from relight3d.relight.relighter import Relighter
from relight3d.shading import cast_light, cast_thrown, mirrored_light, residual_kernel

AWAY, DARK, LIT, NONE = 0, 1, 2, np.inf


class Shown(NamedTuple):
    """What a light does at slots: distance to its shadow's edge, direction to it, falloff."""

    distance: np.ndarray
    to_light: np.ndarray
    falloff: np.ndarray
    power: np.ndarray


class HalfReference:
    """A half-resolution relighter's lattice, read by hand."""

    def __init__(self, relighter: Relighter) -> None:
        assert isinstance(relighter._engine, HalfEngine)
        self.model, self.view, self.scene = relighter.model, relighter.view, relighter._scene
        self.options, self.lattice = relighter.options, relighter._engine.lattice
        self.order = relighter._engine.buffers.order
        self.at = self.order[np.maximum(self.lattice.point, 0)]  # the view's point of each slot
        self.is_there = self.lattice.point >= 0
        self.corner, self.share = self._readings()

    def render(self, lights: list[Light]) -> np.ndarray:
        """Radiance, height x width x 3."""
        model, view, camera = self.model, self.view, self.view.camera
        lights = [light.translated(-model.mesh.center) for light in lights]
        irradiance = self.read(irradiance_at_points(model, view, lights)[self.at])
        normal = self.summed(view.normal)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        out = np.zeros((self.lattice.num_items, 3))
        for light, shown in self.shown(lights):
            part = np.clip(self.read(shown.distance) + 0.5, 0.0, 1.0)
            to_light = self.read(shown.to_light)
            form = part * self.read(shown.falloff) * np.maximum((normal * to_light).sum(axis=1), 0.0)
            irradiance = irradiance + form[:, None] * shown.power
            out += self.highlights(shown, form, normal, to_light) * shown.power
            if light is not None:
                lit, dark = self.residual(light)
                out += light.power * (part[:, None] * lit + (1 - part[:, None]) * dark)
        out += self.summed(view.albedo / np.pi * view.throughput) * irradiance
        picture, given = np.zeros((camera.num_pixels, 3)), (model, view, lights)
        pixel = np.full(self.lattice.num_items, -1)
        pixel[self.lattice.item] = view.points.pixel[self.order]
        np.add.at(picture, pixel[pixel >= 0], out[pixel >= 0])
        np.add.at(
            picture,
            view.miss_pixel,
            (background_radiance(*given) + dark_residual(*given)) * view.miss_throughput[:, None],
        )
        return np.maximum(picture, 0.0).reshape(camera.height, camera.width, 3)

    # ----------------------------------------------------------------------------------------- readings

    def _readings(self) -> tuple[np.ndarray, np.ndarray]:
        """Which slots each item reads, and how much of each: bilinear, but for loose items."""
        lattice, view = self.lattice, self.view
        y, x = np.divmod(view.points.pixel[self.order], view.camera.width)
        first = y // SPACING * lattice.columns + x // SPACING
        right, below = x % SPACING / SPACING, y % SPACING / SPACING
        corner, share = np.zeros((lattice.num_items, 4), int), np.zeros((lattice.num_items, 4))
        steps = np.array([0, 1, lattice.columns, lattice.columns + 1])
        corner[lattice.item] = np.minimum(first[:, None] + steps, len(lattice.point) - 1)
        shares = ((1 - right) * (1 - below), right * (1 - below), (1 - right) * below, right * below)
        share[lattice.item] = np.stack(shares, axis=1)
        loose = lattice.place_of_loose()
        corner[loose], share[loose] = lattice.corner, lattice.share
        return corner, share

    def read(self, values: np.ndarray) -> np.ndarray:
        """Values of slots at items."""
        return np.einsum("ik,ik...->i...", self.share, values[self.corner])

    def summed(self, values: np.ndarray) -> np.ndarray:
        """Values of points (view's order) added up by item."""
        out = np.zeros((self.lattice.num_items, *values.shape[1:]))
        np.add.at(out, self.lattice.item, values[self.order])
        return out

    # ----------------------------------------------------------------------------------------- light

    def shown(self, lights: list[Light]) -> list[tuple[Light | None, Shown]]:
        """Each light with what it does; then the patches that mirrors throw, which belong to none."""
        out: list[tuple[Light | None, Shown]] = []
        points, mirrors, model = self.view.points, self.model.mirrors, self.model
        for light in lights:
            cast = cast_light(self.scene, points, light, points.geometric_normal, shadows=self.options.shadows != "off")
            reach = light.incident(points.position)[1].max(axis=1) / light.power.max()
            state = np.where(cast.is_lit, LIT, np.where(cast.cosine > 0, DARK, AWAY))[self.at]
            state[~self.is_there] = AWAY
            if self.options.shadows != "off":
                self._spare(state)
            distance = self._distance(state, light if self.options.borders and self.options.shadows != "off" else None)
            out.append((light, Shown(distance, cast.to_light[self.at], reach[self.at], light.power)))
        for mirror in mirrors:
            for light in lights if mirror.throws_light else []:
                form, _ = cast_thrown(
                    self.scene, points, light, points.geometric_normal, mirror, model.surfaces.surface_of_face
                )
                virtual = mirrored_light(light, mirror)
                to_light, arriving, _ = virtual.incident(points.position)
                state = np.where((form[self.at] > 0) & self.is_there, LIT, AWAY)
                reach = arriving.max(axis=1) / virtual.power.max()
                given = (to_light[self.at], reach[self.at], light.power * mirror.reflectance)
                out.append((None, Shown(self._distance(state, None), *given)))
        return out

    def _spare(self, state: np.ndarray) -> None:
        """Slots in cells whose corners agree take their state, in place, without a ray."""
        lattice = self.lattice
        corners = state[lattice.cell]
        agreed = np.where((corners == corners[:, :1]).all(axis=1), corners[:, 0], -1)
        one, other = agreed[lattice.later_cell].T if len(lattice.later) else np.zeros((2, 0), int)
        spared = (one == other) & (one >= 0)
        state[lattice.later[spared]] = one[spared]

    def _distance(self, state: np.ndarray, light: Light | None) -> np.ndarray:
        """How far slots are from the edge: half-way, or where rays of the `light` place it."""
        lattice, columns = self.lattice, self.lattice.columns
        near = np.full((len(state), 2), NONE)
        for axis, step in enumerate((1, columns)):
            pairs = np.flatnonzero(lattice.is_joined[axis])
            pairs = pairs[(state[pairs] == LIT) != (state[pairs + step] == LIT)]
            way = np.full(len(pairs), SPACING / 2.0)
            traced = (state[pairs] != AWAY) & (state[pairs + step] != AWAY) & (light is not None)
            if traced.any():
                way[traced] = self._placed(light, axis, step, pairs[traced], state)
            np.minimum.at(near[:, axis], pairs, way)
            np.minimum.at(near[:, axis], pairs + step, SPACING - way)
        away = np.minimum(1 / np.sqrt(np.maximum((1 / near**2).sum(axis=1), 1e-30)), SPACING)
        out = np.where(state == LIT, away, -away)
        grid = out[: lattice.num_grid].reshape(lattice.rows, columns)
        grid[-1], grid[:, -1] = grid[-2], grid[:, -2]
        return out

    def _placed(self, light, axis: int, step: int, pairs: np.ndarray, state: np.ndarray) -> np.ndarray:
        """How far from the left or upper slot of each pair the edge is, by halving, in pixels."""
        points = self.view.points
        is_first_lit = state[pairs] == LIT
        start = self.at[np.where(is_first_lit, pairs, pairs + step)]
        slide = self.view.step[start, axis] * np.where(is_first_lit, SPACING, -SPACING)[:, None].astype(np.float32)
        place = np.zeros(len(pairs), int)
        for k in range(HALVINGS):
            part = (place + (PLACES >> (k + 1))) / np.float32(PLACES)
            between = (points.position[start] + part[:, None] * slide).astype(np.float32)
            to_light, _, distance = light.incident(between)
            origins = self.scene.offset(between, points.geometric_normal[start])
            limit = None if distance[0] >= FAR else distance - 2 * self.scene.offset_distance
            ways = to_light[:1] if limit is None else to_light
            place += np.where(self.scene.is_blocked(origins, ways.astype(np.float32), limit), 0, PLACES >> (k + 1))
        from_lit = (place + 0.5) / PLACES * SPACING
        return np.where(is_first_lit, from_lit, SPACING - from_lit)

    # ----------------------------------------------------------------------------------------- terms

    def highlights(self, shown: Shown, form: np.ndarray, normal: np.ndarray, to_light: np.ndarray) -> np.ndarray:
        """The lobes' radiance for power 1, with the direction to the light along that to the viewer read off slots."""
        view, out = self.view, np.zeros((self.lattice.num_items, 3))
        viewer = self.summed(view.points.to_viewer)
        viewer /= np.maximum(np.linalg.norm(viewer, axis=1, keepdims=True), 1e-9)
        count = np.bincount(self.lattice.item, minlength=self.lattice.num_items)
        place = self.summed(view.points.position) / np.maximum(count, 1)[:, None]
        gloss = self.summed(view.lobe_gain[:, None] * view.throughput)
        surface = np.full(self.lattice.num_items, -1)
        surface[self.lattice.item] = view.surface[self.order]
        toward = self.read((shown.to_light * view.points.to_viewer[self.at]).sum(axis=1))
        n_l, n_v = (normal * to_light).sum(axis=1), (normal * viewer).sum(axis=1)
        along = n_l * n_v
        for number, lobes in enumerate(self.model.lobes):
            mine = np.flatnonzero((surface == number) & (form > 0))
            for lobe in lobes:
                tangent = tangent_frame(normal[mine], lobe.tangent + np.cross(lobe.turn, place[mine]))[0]
                t_l, t_v = ((tangent * way[mine]).sum(axis=1) for way in (to_light, viewer))
                if lobe.is_halfway:
                    is_round = lobe.axes[0] == lobe.axes[1]
                    whole, ahead = 2 + 2 * toward[mine], (n_l + n_v)[mine] ** 2
                    aside = 0.0 if is_round else (t_l + t_v) ** 2
                    rest = np.maximum(whole - ahead - aside, 0.0)
                    base = whole / (lobe.axes[0] * aside + lobe.axes[1] * rest + lobe.axes[2] * ahead)
                else:
                    both = t_l * t_v if lobe.axes[0] != lobe.axes[1] else 0.0
                    base = lobe.axes[0] * both + lobe.axes[1] * ((toward - along)[mine] - both)
                    base += lobe.axes[2] * along[mine]
                out[mine] += np.clip(base, 0.0, 1.0)[:, None] ** lobe.exponent * lobe.color * form[mine, None]
        return out * gloss

    def residual(self, light: Light) -> tuple[np.ndarray, np.ndarray]:
        """The residual of items for a light of power 1, lit and dark; a point has a part of its pixel's."""
        residual, model, view = self.model.residual, self.model, self.view
        if residual is None:
            return np.zeros((self.lattice.num_items, 3)), np.zeros((self.lattice.num_items, 3))
        softening = model.indirect.softening if model.indirect is not None else 0.5 * model.mesh.radius
        source, share = residual_source(model, view)
        part = 1 / np.bincount(view.points.pixel)[view.points.pixel]
        out = []
        for modes, weights in zip(
            (residual.lit_modes, residual.dark_modes), residual_kernel(residual, light, softening)
        ):
            at_captured = np.einsum("pmc,m->pc", modes, weights)
            at_points = np.einsum("pk,pkc->pc", share, at_captured[np.maximum(source, 0)])
            out.append(self.summed(at_points * part[:, None]))
        return out[0], out[1]
