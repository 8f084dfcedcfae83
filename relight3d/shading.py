"""The one forward model: which point a pixel shows, how a light reaches it, what it sends back.

The fits, the frames and the tests all use these functions; the fast kernels of relight/ are held to them. Linear in
the light: everything is stated for a light of power 1, and multiplied by its colour at the end.

    radiance = albedo / pi * (power * form + indirect irradiance) + power * form * sum of lobes + residual

Differs from the paper: a lobe is multiplied by the cosine (form = falloff * cosine where seen), so that `albedo` and
lobe are both BRDFs and the contract's units hold.
"""

import numpy as np
from jaxtyping import Float, Float32, Int, Int32

from relight3d.camera import Camera
from relight3d.lights import FAR, DirectionalLight, Light, RectangleSample, SpotLight
from relight3d.maths.halfway import halfway_base, halfway_energy, round_halfway_base
from relight3d.maths.lafortune import lobe_base, lobe_energy, power
from relight3d.maths.light_basis import evaluate_basis, within_reach
from relight3d.records import Indirect, Lighting, Lobe, Mirror, PatchMesh, Residual, ShadingPoints
from relight3d.tracing import RayScene

# A mesh made from a depth map has its vertices on the pixels' centres, and a ray aimed exactly at a vertex slips
# through the mesh once in a hundred. A thousandth of a pixel aside there is no vertex, and nothing else changes.
NUDGE_PX = np.array([1.7e-3, 1.1e-3])


def ray_scene(mesh: PatchMesh) -> RayScene:
    """The mesh made ready for rays, in centred coordinates."""
    return RayScene(mesh.centered_vertices, mesh.faces)


# --------------------------------------------------------------------------------------------- points


def points_seen(scene: RayScene, mesh: PatchMesh, camera: Camera) -> ShadingPoints:
    """What each pixel's centre sees of the mesh; pixels that miss it have no point."""
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
    image_points = np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], axis=1) + NUDGE_PX
    return points_along(scene, mesh, camera, np.arange(camera.num_pixels), image_points)


def points_along(
    scene: RayScene,
    mesh: PatchMesh,
    camera: Camera,
    pixel: Int[np.ndarray, " ray"],
    image_points: Float[np.ndarray, "ray 2"],
) -> ShadingPoints:
    """What the rays through image points (x, y) see of the mesh, each kept under its pixel."""
    directions = camera.directions(image_points).astype(np.float32)
    origin = (camera.center - mesh.center).astype(np.float32)
    return _points_along(scene, mesh, pixel, np.broadcast_to(origin, directions.shape), directions)


def points_mirrored(scene: RayScene, mesh: PatchMesh, points: ShadingPoints) -> ShadingPoints:
    """What the points show if they are mirrors: the first hits of the reflected rays (1.1.3).

    Keeps the pixel; `depth` adds the way to the mirror. Points whose reflection misses the mesh are left out, and so
    are those that reflect to below their own surface.
    """
    toward = reflected(points)
    above = _dot(toward, points.geometric_normal) > 0
    points, toward = points.take(above), toward[above].astype(np.float32)
    origins = scene.offset(points.position, points.geometric_normal)
    return _points_along(scene, mesh, points.pixel, origins, toward, points.depth)


def reflected(points: ShadingPoints) -> Float32[np.ndarray, "point 3"]:
    """The direction in which each point mirrors its viewer."""
    return 2 * _dot(points.normal, points.to_viewer)[:, None] * points.normal - points.to_viewer


def _points_along(
    scene: RayScene,
    mesh: PatchMesh,
    pixel: np.ndarray,
    origins: np.ndarray,
    directions: Float32[np.ndarray, "ray 3"],
    way: np.ndarray | float = 0.0,
) -> ShadingPoints:
    hits = scene.first_hit(origins, directions)
    hit = hits.face >= 0
    barycentric = np.stack([1.0 - hits.u - hits.v, hits.u, hits.v], axis=1)[hit].astype(np.float32)
    face, to_viewer = hits.face[hit], -directions[hit]
    corners = mesh.faces[face]
    # From the corners, not from the ray: a camera far away would spoil the last digits that the offset relies on.
    position = np.einsum("pk,pki->pi", barycentric, mesh.centered_vertices[corners])
    geometric = mesh.face_normals[face]
    geometric = geometric * np.where(_dot(geometric, to_viewer) < 0, -1.0, 1.0)[:, None].astype(np.float32)
    normal = np.einsum("pk,pki->pi", barycentric, mesh.vertex_normals[corners])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-6), geometric)
    normal = normal * np.where(_dot(normal, geometric) < 0, -1.0, 1.0)[:, None]
    return ShadingPoints(
        pixel=pixel[hit].astype(np.int32),
        face=face,
        barycentric=barycentric,
        position=np.ascontiguousarray(position, np.float32),
        geometric_normal=np.ascontiguousarray(geometric, np.float32),
        normal=np.ascontiguousarray(normal, np.float32),
        to_viewer=np.ascontiguousarray(to_viewer, np.float32),
        depth=((hits.distance + way)[hit]).astype(np.float32),
    )


# --------------------------------------------------------------------------------------------- light


def cast_light(
    scene: RayScene,
    points: ShadingPoints,
    light: Light,
    normal: Float32[np.ndarray, "point 3"] | None = None,
    mirrors: tuple[Mirror, ...] = (),
    surface_of_face: Int32[np.ndarray, " face"] | None = None,
    shadows: bool = True,
) -> Lighting:
    """How a light (centred coordinates) reaches the points: one shadow ray for each that faces it.

    A point is lit when both its geometric and its shading normal face the light and nothing stands between. `normal`
    replaces the points' own (detail). For plane mirrors that throw light, see `cast_thrown`. Without `shadows` whatever
    faces the light is lit, and no ray is cast.
    """
    normal = points.normal if normal is None else normal
    to_light, irradiance, distance = light.incident(points.position)
    falloff = _scalar_falloff(light, irradiance)
    cosine = _dot(normal, to_light)
    asks = (cosine > 0) & (_dot(points.geometric_normal, to_light) > 0) & (falloff > 0)
    asked = np.flatnonzero(asks)
    is_lit = np.zeros(len(points), dtype=bool)
    if not shadows:
        is_lit[asked], asked = True, asked[:0]
    if len(asked):
        origins = scene.offset(points.position[asked], points.geometric_normal[asked])
        at_infinity = distance[0] >= FAR
        ways = to_light[:1] if at_infinity else to_light[asked]
        limit = None if at_infinity else distance[asked] - 2 * scene.offset_distance
        is_lit[asked] = ~scene.is_blocked(origins, ways, limit)
    form = np.where(is_lit, falloff * cosine, 0.0).astype(np.float32)
    throwing = [m for m in mirrors if m.throws_light]
    thrown, num_thrown = None, 0
    if throwing and surface_of_face is not None:
        parts = [cast_thrown(scene, points, light, normal, mirror, surface_of_face) for mirror in throwing]
        thrown, num_thrown = np.stack([p[0] for p in parts]), sum(p[1] for p in parts)
    return Lighting(
        np.asarray(to_light, np.float32), cosine.astype(np.float32), form, is_lit, thrown, len(asked), num_thrown
    )


def cast_thrown(
    scene: RayScene,
    points: ShadingPoints,
    light: Light,
    normal: Float32[np.ndarray, "point 3"],
    mirror: Mirror,
    surface_of_face: Int32[np.ndarray, " face"],
) -> tuple[Float32[np.ndarray, " point"], int]:
    """The sharp patch that a plane mirror throws: the light of a virtual lamp, seen through the mirror's outline.

    The lamp is mirrored in the plane; a point gets its light when the ray towards it meets the mirror's front first
    and the way on from there to the real lamp is free. Two rays, for points that face the virtual lamp from the
    mirror's front and whose ray crosses the plane inside the mirror's bounding disc.
    """
    virtual = mirrored_light(light, mirror)
    to_light, irradiance, distance = virtual.incident(points.position)
    falloff, cosine = _scalar_falloff(virtual, irradiance), _dot(normal, to_light)
    toward = to_light @ mirror.normal.astype(np.float32)
    height = (points.position - mirror.point.astype(np.float32)) @ mirror.normal.astype(np.float32)
    asks = (cosine > 0) & (_dot(points.geometric_normal, to_light) > 0) & (falloff > 0) & (toward < 0)
    asks &= height > 4 * scene.offset_distance
    # Where the ray meets the plane, it must be near the mirror: most points are ruled out here, without a ray.
    reach = height / np.maximum(-toward, 1e-6)
    crossing = points.position + reach[:, None] * to_light
    asks &= np.linalg.norm(crossing - mirror.point, axis=1) <= mirror.radius * 1.001
    asks &= reach < distance
    form = np.zeros(len(points), np.float32)
    asked = np.flatnonzero(asks)
    if len(asked) == 0:
        return form, 0
    ways = np.ascontiguousarray(to_light[asked], np.float32)
    origins = scene.offset(points.position[asked], points.geometric_normal[asked])
    first = scene.first_hit(origins, ways)
    through = (first.face >= 0) & (surface_of_face[np.maximum(first.face, 0)] == mirror.surface)
    through &= np.abs(first.distance - reach[asked]) <= 1e-3 * reach[asked] + 16 * scene.offset_distance
    asked = asked[through]
    bounce = (crossing[asked] + mirror.normal * (4 * scene.offset_distance)).astype(np.float32)
    onward, _, left = light.incident(bounce)
    limit = None if left.size and left[0] >= FAR else left - 2 * scene.offset_distance
    free = ~scene.is_blocked(bounce, onward, limit) if len(asked) else np.zeros(0, bool)
    lit = asked[free]
    form[lit] = (falloff * cosine)[lit]
    return form, len(ways) + len(bounce)


def mirrored_light(light: Light, mirror: Mirror) -> Light:
    """The lamp behind a plane mirror that its reflection seems to come from."""
    from dataclasses import replace

    n = mirror.normal
    flip = np.eye(3) - 2 * np.outer(n, n)
    if isinstance(light, DirectionalLight):
        return replace(light, to_light=tuple(flip @ np.asarray(light.to_light)))
    place = np.asarray(light.position) - 2 * ((np.asarray(light.position) - mirror.point) @ n) * n
    if isinstance(light, SpotLight):
        return light.moved(position=tuple(place), direction=tuple(flip @ np.asarray(light.direction)))
    if isinstance(light, RectangleSample):
        return replace(light, position=tuple(place), normal=tuple(flip @ np.asarray(light.normal)))
    return replace(light, position=tuple(place))


def _scalar_falloff(light: Light, irradiance: np.ndarray) -> np.ndarray:
    """Irradiance for a light of power 1: the channels share one falloff, so the strongest tells it."""
    channel = int(np.argmax(light.power))
    strongest = light.power[channel]
    return irradiance[:, channel] / strongest if strongest > 0 else np.zeros(len(irradiance), irradiance.dtype)


# --------------------------------------------------------------------------------------------- materials


def lobe_brdf(
    lobes: tuple[Lobe, ...],
    normal: Float[np.ndarray, "*points 3"],
    to_light: Float[np.ndarray, "*points 3"],
    to_viewer: Float[np.ndarray, "*points 3"],
    position: Float[np.ndarray, "*points 3"] | None = None,
) -> Float[np.ndarray, "*points 3"]:
    """The sum of a surface's lobes, eq. (4), in 1/steradian; a brushed one asks for positions (centred)."""
    total = np.zeros(np.broadcast_shapes(normal.shape, to_light.shape), normal.dtype)
    for lobe in lobes:
        axes = lobe.axes.astype(normal.dtype)
        if lobe.is_halfway and axes[0] == axes[1]:
            base = round_halfway_base(normal, to_light, to_viewer, axes)
        elif lobe.is_halfway:
            assert position is not None, "a brushed lobe's tangent goes by the place"
            along = (lobe.tangent + np.cross(lobe.turn, position)).astype(normal.dtype)
            base = halfway_base(normal, to_light, to_viewer, axes, along)
        else:
            base = lobe_base(normal, to_light, to_viewer, axes, lobe.tangent if np.any(lobe.tangent) else None)
        total += power(base, lobe.exponent)[..., None] * lobe.color.astype(normal.dtype)
    return total


def largest_albedo(lobe: Lobe) -> float:
    """The most that a lobe of colour 1 sends back of what arrives, for any viewer."""
    energy = halfway_energy if lobe.is_halfway else lobe_energy
    return energy(np.asarray(lobe.axes), lobe.exponent)


def energy_of(lobes: tuple[Lobe, ...]) -> float:
    """The most that lobes together send back of what arrives, for any viewer and colour."""
    return float(np.max(sum(lobe.color * largest_albedo(lobe) for lobe in lobes), initial=0.0))


def light_strength(
    light: Light, sites: Float[np.ndarray, "site 3"], softening: float
) -> tuple[Float[np.ndarray, "site 3"], Float[np.ndarray, " site"]]:
    """Direction to a light and its strength at each site for power 1: 1 at infinity, else 1 / distance^2, softened.

    The light's place and direction are all that the indirect light may know of it (1.4). A lamp's strength does not
    know the surface's cosine; within `softening` it stops growing, as the light that other surfaces send does.
    """
    to_light, _, distance = light.incident(sites)
    if isinstance(light, DirectionalLight):
        return to_light, np.ones(len(sites), sites.dtype)
    # A spot lights a part of the scene: what others send on is scaled by the part, wherever the site lies.
    part = float(np.mean(light.cone(to_light)))
    return to_light, part / np.maximum(distance, softening) ** 2


def indirect_design(
    indirect_basis: str,
    light: Light,
    sites: Float[np.ndarray, "site 3"],
    anchors: Float[np.ndarray, "anchor 3"],
    reach_rad: float,
    softening: float,
) -> Float[np.ndarray, "row basis"]:
    """strength * basis at each site, for power 1. One row, to be broadcast, for a light at infinity."""
    sites = np.asarray(sites[:1] if light.kind == "directional" else sites, np.float64)
    to_light, strength = light_strength(light, sites, softening)
    direction, _ = within_reach(np.asarray(to_light, np.float64), anchors, reach_rad)
    return evaluate_basis(indirect_basis, direction) * np.asarray(strength)[:, None]


def indirect_irradiance(
    indirect: Indirect, lights: list[Light], sites: Float[np.ndarray, "site 3"]
) -> Float32[np.ndarray, "site 3"]:
    """Indirect and ambient irradiance at the sites under lights (centred), eq. (7); ambient once, never below 0."""
    total = indirect.ambient.astype(np.float64)
    for light in lights:
        rows = indirect_design(indirect.basis, light, sites, indirect.anchors, indirect.reach_rad, indirect.softening)
        if len(rows) == 1:
            part = np.einsum("nbc,b->nc", indirect.coefficients, rows[0])
        else:
            part = np.einsum("nbc,nb->nc", indirect.coefficients, rows)
        total = total + part * light.power
    return np.maximum(total, 0.0).astype(np.float32)


def residual_kernel(
    residual: Residual, light: Light, softening: float
) -> tuple[Float[np.ndarray, " lit"], Float[np.ndarray, " dark"]]:
    """How strongly the lit and the dark modes of the residual answer to a light of power 1 (centred coordinates)."""
    to_light, strength = light_strength(light, np.zeros((1, 3)), softening)
    angle = np.arccos(np.clip(to_light @ residual.anchors.T, -1.0, 1.0))[0]
    lit, dark = (
        np.exp(-angle / length) * strength[0] for length in (residual.lit_length_rad, residual.dark_length_rad)
    )
    return residual.lit_weights @ lit, residual.dark_weights @ dark


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", a, b)
