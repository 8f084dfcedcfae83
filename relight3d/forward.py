"""A whole view under lights: the readable reference that the fast kernels are held to."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int32

from relight3d.lights import FAR, Light
from relight3d.maths.light_basis import evaluate_basis, within_reach
from relight3d.maths.pixel_parts import FULL, HALVINGS, PLACES, own_part
from relight3d.records import Lighting, RelightModel
from relight3d.shading import (
    cast_light,
    indirect_irradiance,
    light_strength,
    lobe_brdf,
    mirrored_light,
    residual_kernel,
)
from relight3d.tracing import RayScene
from relight3d.views import View


class Shaded(NamedTuple):
    """Radiance of a view's points by term, before throughput; how far each light is seen; and the rays it took."""

    direct: Float32[np.ndarray, "point 3"]
    specular: Float32[np.ndarray, "point 3"]
    indirect: Float32[np.ndarray, "point 3"]
    seen: Float32[np.ndarray, "light point"]  # 0 in shadow or turned away, 1 lit, between on a shadow's border
    num_rays: int
    num_thrown_rays: int
    num_border_rays: int


def shade_points(
    scene: RayScene, model: RelightModel, view: View, lights: list[Light], shadows: bool = True, borders: bool = True
) -> Shaded:
    """The forward model at a view's points under lights in centred coordinates.

    `shadows` off lights all that faces a light; `borders` off leaves shadow borders as hard as the pixels.
    """
    shape = (len(view.points), 3)
    direct, specular = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    throwing = [m for m in model.mirrors if m.throws_light]
    seen = np.zeros((len(lights), len(view.points)), np.float32)
    rays = thrown_rays = border_rays = 0
    for index, light in enumerate(lights):
        lit = cast_light(scene, view.points, light, view.normal, model.mirrors, model.surfaces.surface_of_face, shadows)
        rays, thrown_rays = rays + lit.num_rays, thrown_rays + lit.num_thrown_rays
        seen[index], form = lit.is_lit, lit.form
        if shadows and borders:
            on_border, fraction, num = border_fractions(scene, view, light, lit)
            border_rays += num
            form = form.copy()
            form[on_border] = fraction * unshadowed_form(view, light, on_border)
            seen[index, on_border] = fraction
        color = light.power.astype(np.float32)
        direct += form[:, None] * color
        specular += specular_radiance(model, view, lit.to_light, form) * color
        for mirror, patch in zip(throwing, lit.thrown if lit.thrown is not None else (), strict=False):
            tint = color * mirror.reflectance.astype(np.float32)
            direct += patch[:, None] * tint
            to_virtual = mirrored_light(light, mirror).incident(view.points.position)[0]
            specular += specular_radiance(model, view, np.asarray(to_virtual, np.float32), patch) * tint
    direct *= view.albedo / np.float32(np.pi)
    indirect = view.albedo / np.float32(np.pi) * irradiance_at_points(model, view, lights)
    return Shaded(direct, specular, indirect, seen, rays, thrown_rays, border_rays)


def shadow_borders(view: View, lit: Lighting) -> tuple[Int32[np.ndarray, " pair"], ...]:
    """Neighbours in the picture that both face the light and are in different states: the lit point of each pair, the dark
    one, and which neighbour of the lit one that is.
    """
    faces = (lit.cosine > 0) & (np.einsum("pi,pi->p", view.points.geometric_normal, lit.to_light) > 0)
    dark = np.append(faces & ~lit.is_lit, False)  # the last one for no neighbour
    point, way = np.nonzero(lit.is_lit[:, None] & dark[view.neighbour])
    return point.astype(np.int32), view.neighbour[point, way], way.astype(np.int32)


def border_fractions(
    scene: RayScene, view: View, light: Light, lit: Lighting
) -> tuple[np.ndarray, Float32[np.ndarray, " border"], int]:
    """Points on shadow borders, the share of each one's pixel that sees the light, and the rays it took.

    A photograph's pixel mixes the two sides of a border; one ray through its centre takes a side. Rays between the two
    centres place the edge by halving; what of each pixel lies beside it is an area.
    """
    one, other, way = shadow_borders(view, lit)
    points, axis, sign = view.points, way // 2, np.float32(1) - 2 * (way % 2)
    place = np.zeros(len(one), np.int32)
    for k in range(HALVINGS if len(one) else 0):
        half = PLACES >> (k + 1)
        part = (sign * ((place + half) / PLACES)).astype(np.float32)
        moved = points.position[one] + part[:, None] * view.step[one, axis]
        to_light, _, distance = light.incident(moved)
        limit = None if distance[0] >= FAR else distance - 2 * scene.offset_distance
        origins = scene.offset(moved, points.geometric_normal[one])
        place[~scene.is_blocked(origins, to_light[:1] if limit is None else to_light, limit)] += half
    edges = np.zeros((len(points), 4), np.uint8)
    edges[one, way], edges[other, way ^ 1] = place + 1, PLACES - place
    border = np.flatnonzero(edges.any(axis=1))
    own = own_part(edges[border])
    seen = np.where(lit.is_lit[border], own, FULL - own)
    return border, (seen / np.float32(FULL)).astype(np.float32), HALVINGS * len(one)


def unshadowed_form(view: View, light: Light, index: np.ndarray) -> Float32[np.ndarray, " index"]:
    """falloff * cosine as if nothing stood between, for power 1."""
    to_light, irradiance, _ = light.incident(view.points.position[index])
    channel = int(np.argmax(light.power))
    falloff = irradiance[:, channel] / max(float(light.power[channel]), 1e-30)
    cosine = np.maximum(np.einsum("pi,pi->p", view.normal[index], to_light), 0.0)
    return (falloff * cosine).astype(np.float32)


def specular_radiance(
    model: RelightModel, view: View, to_light: Float32[np.ndarray, "point 3"], form: Float32[np.ndarray, " point"]
) -> Float32[np.ndarray, "point 3"]:
    """The lobes' radiance for power 1; only points that are lit, on surfaces that have lobes, cost anything."""
    out = np.zeros((len(form), 3), np.float32)
    for surface, lobes in enumerate(model.lobes):
        if lobes:
            mine = np.flatnonzero((view.surface == surface) & (form > 0))
            brdf = lobe_brdf(
                lobes, view.normal[mine], to_light[mine], view.points.to_viewer[mine], view.points.position[mine]
            )
            out[mine] = brdf * (form * view.lobe_gain)[mine, None]
    return out


def irradiance_at_points(model: RelightModel, view: View, lights: list[Light]) -> Float32[np.ndarray, "point 3"]:
    """Indirect and ambient irradiance at a view's points, blended over each face where the sites are vertices."""
    mesh, indirect, points = model.mesh, model.indirect, view.points
    if indirect is None:
        return np.zeros((len(points), 3), np.float32)
    if indirect.site == "vertex":
        at_sites = indirect_irradiance(indirect, lights, mesh.centered_vertices)
        return np.einsum("pk,pkc->pc", points.barycentric, at_sites[mesh.faces[points.face]])
    if indirect.site == "face":
        at_sites = indirect_irradiance(indirect, lights, mesh.centered_vertices[mesh.faces].mean(axis=1))
        return at_sites[points.face]
    at_sites = indirect_irradiance(indirect, lights, model.pixels.points.position)
    return np.einsum("pk,pkc->pc", view.share, at_sites[np.maximum(view.source, 0)])


def background_radiance(model: RelightModel, view: View, lights: list[Light]) -> Float32[np.ndarray, "miss 3"]:
    """The unmodelled surroundings at the pixels whose mirror shows them (the mirror's own colour is in the fit)."""
    background, indirect = model.background, model.indirect
    if background is None or indirect is None or len(view.miss_pixel) == 0:
        return np.zeros((len(view.miss_pixel), 3), np.float32)
    rows = np.maximum(view.miss_source, 0)
    total = background.ambient[rows].astype(np.float64)
    for light in lights:
        to_light, strength = light_strength(light, np.zeros((1, 3)), indirect.softening)
        direction, _ = within_reach(to_light, indirect.anchors, indirect.reach_rad)
        functions = evaluate_basis(indirect.basis, direction)[0] * strength[0]
        total += np.einsum("mbc,b->mc", background.coefficients[rows], functions) * light.power
    return np.where(view.miss_source[:, None] >= 0, np.maximum(total, 0.0), 0.0).astype(np.float32)


def residual_radiance(
    model: RelightModel, view: View, lights: list[Light], seen: Float32[np.ndarray, "light point"]
) -> Float32[np.ndarray, "point 3"]:
    """The interpolated misfit at a view's points: read where the spot was captured, faded where it is now seen from
    another side (a gloss or a mirror does not look the same from there).
    """
    residual, out = model.residual, np.zeros((len(view.points), 3), np.float32)
    if residual is None:
        return out
    source, share = residual_source(model, view)
    there = np.maximum(source, 0)
    for index, light in enumerate(lights):
        lit_weights, dark_weights = residual_kernel(residual, light, _softening(model))
        lit = np.einsum("pmc,m->pc", residual.lit_modes, lit_weights)
        dark = np.einsum("pmc,m->pc", residual.dark_modes, dark_weights)
        blend = seen[index][:, None, None] * lit[there] + (1 - seen[index])[:, None, None] * dark[there]
        out += np.einsum("pk,pkc->pc", share, blend) * light.power.astype(np.float32)
    return out


def residual_source(model: RelightModel, view: View) -> tuple[np.ndarray, np.ndarray]:
    """From which captured points each point of a view reads its residual, and with which shares."""
    if view.camera.same_as(model.camera):
        # Every point of a pixel, in a mirror or on an outline, answers for that pixel's own misfit.
        index = np.full(view.camera.num_pixels, -1, np.int32)
        index[model.pixels.points.pixel] = np.arange(len(model.pixels.points), dtype=np.int32)
        own = index[view.points.pixel][:, None]
        return own, (own >= 0).astype(np.float32)
    there = np.maximum(view.source, 0)
    alike = np.einsum("pki,pi->pk", model.pixels.points.to_viewer[there], view.points.to_viewer)
    fade = np.clip((alike - np.cos(np.radians(30))) / (np.cos(np.radians(8)) - np.cos(np.radians(30))), 0.0, 1.0)
    return view.source, (view.share * fade * ~view.is_mirrored[:, None]).astype(np.float32)


def dark_residual(model: RelightModel, view: View, lights: list[Light]) -> Float32[np.ndarray, "miss 3"]:
    """The residual of pixels whose mirror shows the surroundings, which no light of ours reaches."""
    out = np.zeros((len(view.miss_pixel), 3), np.float32)
    if model.residual is None or len(out) == 0 or not view.camera.same_as(model.camera):
        return out
    index = np.full(view.camera.num_pixels, -1, np.int32)
    index[model.pixels.points.pixel] = np.arange(len(model.pixels.points), dtype=np.int32)
    modes = model.residual.dark_modes[index[view.miss_pixel]]
    for light in lights:
        _, weights = residual_kernel(model.residual, light, _softening(model))
        out += (np.einsum("pmc,m->pc", modes, weights) * light.power).astype(np.float32)
    return out


def _softening(model: RelightModel) -> float:
    return model.indirect.softening if model.indirect is not None else 0.5 * model.mesh.radius


class Picture(NamedTuple):
    """Radiance of every pixel by term; they add up to the frame."""

    direct: Float32[np.ndarray, "pixel 3"]
    specular: Float32[np.ndarray, "pixel 3"]
    indirect: Float32[np.ndarray, "pixel 3"]  # with the residual: all that is fitted, not computed
    mirror: Float32[np.ndarray, "pixel 3"]  # all that is seen in mirrors


def gather_pixels(model: RelightModel, view: View, lights: list[Light], shaded: Shaded) -> Picture:
    """The points' radiance put together to pixels, mirrors and shared pixels included."""
    num, pixel = view.camera.num_pixels, view.points.pixel
    residual = residual_radiance(model, view, lights, shaded.seen)
    # A residual is the whole pixel's: points take it by their share, unweakened by the mirrors on the way.
    counts = np.maximum(np.bincount(pixel, minlength=num), 1)[pixel][:, None]
    fitted = shaded.indirect * view.throughput + residual / counts

    def pixels(values: np.ndarray, which: np.ndarray) -> np.ndarray:
        out = [np.bincount(pixel[which], values[which, c].astype(np.float64), num) for c in range(3)]
        return np.stack(out, axis=1).astype(np.float32)

    plain = ~view.is_mirrored
    direct, specular = shaded.direct * view.throughput, shaded.specular * view.throughput
    mirror = pixels(direct + specular + fitted, view.is_mirrored)
    background = (background_radiance(model, view, lights) + dark_residual(model, view, lights)) * (
        view.miss_throughput[:, None]
    )
    np.add.at(mirror, view.miss_pixel, background)
    return Picture(pixels(direct, plain), pixels(specular, plain), pixels(fitted, plain), mirror)
