"""What the scene truly is at each pixel's centre, for tests only (`variant.choose` comes first)."""

from dataclasses import dataclass

import mitsuba as mi
import numpy as np
from scipy.ndimage import map_coordinates

from desk.lights import Lamp
from desk.patterns import painted_atlas, relief_normals
from desk.settings import SceneSettings, View

NO_SURFACE = 255
SHADOW_LIFT_M = 1e-5


@dataclass(frozen=True)
class Truth:
    """Per pixel; zero, and label NO_SURFACE, where the camera does not see the mesh."""

    label: np.ndarray  # uint8 (height, width): object_id
    depth_m: np.ndarray  # distance along the ray
    points: np.ndarray  # (height, width, 3)
    face_normals: np.ndarray
    normals: np.ndarray  # the shading normal, relief included
    albedo: np.ndarray  # diffuse, zero on a mirror


def pixel_rays(view: View, world_from_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions through the pixel centres, by the contract's convention and not by Mitsuba's."""
    row, column = np.mgrid[0 : view.height_px, 0 : view.width_px] + 0.5
    x = (column - view.width_px / 2) / view.focal_px
    y = -(row - view.height_px / 2) / view.focal_px
    in_camera = np.stack([x, y, -np.ones_like(x)], -1).reshape(-1, 3)
    directions = in_camera @ world_from_camera[:3, :3].T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.broadcast_to(world_from_camera[:3, 3], directions.shape), directions


def sensor_error_px(scene, view: View, world_from_camera: np.ndarray) -> float:
    """How far Mitsuba's rays, projected by the contract's formulas, lie from the pixel centres they were asked for."""
    errors = []
    for column, row in (
        (0, 0),
        (view.width_px - 1, 0),
        (0, view.height_px - 1),
        (view.width_px // 2, view.height_px // 3),
    ):
        asked = np.array([column + 0.5, row + 0.5])
        position = mi.Point2f(*(asked / [view.width_px, view.height_px]).tolist())
        ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
        x, y, z = np.array(ray.d, np.float64).ravel() @ world_from_camera[:3, :3]
        got = [view.width_px / 2 - view.focal_px * x / z, view.height_px / 2 + view.focal_px * y / z]
        errors.append(np.abs(got - asked).max())
    return float(f"{max(errors):.2g}")


def each_ray(trace, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """`trace(ray) -> list of numbers`, for all rays at once, or one by one in the scalar variant: (ray, number)."""
    if mi.variant().startswith("scalar"):
        pairs = zip(origins.tolist(), directions.tolist(), strict=True)
        return np.array([[float(v) for v in trace(mi.Ray3f(mi.Point3f(o), mi.Vector3f(d)))] for o, d in pairs])
    rays = mi.Ray3f(
        mi.Point3f(*map(mi.Float, origins.T.astype(np.float32))),
        mi.Vector3f(*map(mi.Float, directions.T.astype(np.float32))),
    )
    return np.stack([np.broadcast_to(np.array(mi.Float(v)), len(origins)) for v in trace(rays)], 1)


def measure_truth(settings: SceneSettings, scene, world_from_camera: np.ndarray) -> Truth:
    shapes = {shape.id(): shape for shape in scene.shapes()}
    things = [shapes[f"thing_{i:02d}"] for i in range(len(settings.things))]

    def trace(ray):
        si = scene.ray_intersect(ray)
        return [si.t, *si.n, *si.sh_frame.n, *si.uv, *(si.shape == thing for thing in things)]

    view = settings.view
    origins, directions = pixel_rays(view, world_from_camera)
    held = each_ray(trace, origins, directions)
    is_thing = held[:, 9:] > 0.5
    is_seen = is_thing.any(1)
    label = np.where(is_seen, is_thing.argmax(1), NO_SURFACE)
    depth = np.where(is_seen, held[:, 0], 0.0)
    face_normals, normals, uv = held[:, 1:4], held[:, 4:7], held[:, 7:9]
    albedo = np.zeros_like(normals)
    for i, thing in enumerate(settings.things):
        mine = label == i
        albedo[mine] = thing.material.albedo
        if thing.material.kind == "textured":
            albedo[mine] = look_up(painted_atlas(thing.material.albedo), uv[mine])
        if thing.material.has_relief:
            # The relief's tangent frame is the world's: the table top faces +z, u runs along x, v along y.
            is_top = mine & (face_normals[:, 2] > 0.99)
            relief = look_up(relief_normals(settings.relief, thing.size[:2]), uv[is_top])
            normals[is_top] = relief / np.linalg.norm(relief, axis=1, keepdims=True)
    shape = (view.height_px, view.width_px)
    flat = depth, origins + depth[:, None] * directions, face_normals, normals, albedo
    masked = [np.where(is_seen.reshape(-1, *[1] * (a.ndim - 1)), a, 0.0).reshape(*shape, *a.shape[1:]) for a in flat]
    return Truth(label.reshape(shape).astype(np.uint8), *masked)


def look_up(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Bilinear, row 0 at v = 0, clamped at the rim."""
    where = [uv[:, 1] * image.shape[0] - 0.5, uv[:, 0] * image.shape[1] - 0.5]
    return np.stack([map_coordinates(image[..., i], where, order=1, mode="nearest") for i in range(3)], -1)


def to_lamp(lamp: Lamp, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions to the lamp, and its irradiance there on a surface that faces it, for a lamp of unit power."""
    if lamp.position is None:
        return np.broadcast_to(lamp.to_light, points.shape), np.ones(points.shape[:-1])
    rays = np.array(lamp.position) - points
    distance = np.linalg.norm(rays, axis=-1)
    return rays / distance[..., None], 1 / distance**2


def measure_is_lit(scene, truth: Truth, lamp: Lamp) -> np.ndarray:
    """Where the pixel's centre sees the lamp itself and faces it (by both normals)."""
    direction, _ = to_lamp(lamp, truth.points)
    facing = np.minimum((truth.face_normals * direction).sum(-1), (truth.normals * direction).sum(-1))
    asked = np.flatnonzero((facing > 0) & (truth.label != NO_SURFACE))
    points = (truth.points + SHADOW_LIFT_M * truth.face_normals).reshape(-1, 3)[asked]
    rays = np.broadcast_to(direction, truth.points.shape).reshape(-1, 3)[asked]
    farthest = np.inf if lamp.position is None else 1.0
    if lamp.position is not None:
        rays = np.array(lamp.position) - points

    def trace(ray):
        si = scene.ray_intersect_preliminary(ray)
        return [si.t]

    is_lit = np.zeros(truth.label.size, bool)
    if len(asked):
        distance = each_ray(trace, points, rays)[:, 0]
        is_lit[asked] = ~(distance < farthest)
    return is_lit.reshape(truth.label.shape)
