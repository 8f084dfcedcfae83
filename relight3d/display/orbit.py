"""Moving the camera about a scene, and looking from there at what was painted for the captured view."""

import numpy as np
from jaxtyping import Float, Float32, UInt8

from relight3d.camera import Camera
from relight3d.display.pictures import DULL, EMPTY
from relight3d.records import RelightModel, ShadingPoints
from relight3d.shading import points_seen
from relight3d.tracing import RayScene
from relight3d.views import look_up


def orbited(
    camera: Camera, pivot: Float[np.ndarray, "3"], pole: Float[np.ndarray, "3"], right_rad: float, up_rad: float
) -> Camera:
    """The camera carried around the pivot: to its right about the pole, and upwards to 5 degrees from the pole."""
    pose = camera.world_from_camera
    across = _rotation(pole, right_rad) @ pose[:3, 0]
    offset = _rotation(pole, right_rad) @ (pose[:3, 3] - pivot)
    height = np.arccos(np.clip(offset @ pole / max(float(np.linalg.norm(offset)), 1e-12), -1.0, 1.0))
    up_rad = float(np.clip(up_rad, height - np.radians(175.0), height - np.radians(5.0)))
    turn = _rotation(across, -up_rad) @ _rotation(pole, right_rad)
    moved = pose.copy()
    moved[:3, :3] = turn @ pose[:3, :3]
    moved[:3, 3] = pivot + turn @ (pose[:3, 3] - pivot)
    return Camera.from_transform(_orthonormal(moved), camera)


def zoomed(camera: Camera, pivot: Float[np.ndarray, "3"], factor: float) -> Camera:
    """The camera at `factor` times its distance from the pivot."""
    pose = camera.world_from_camera.copy()
    pose[:3, 3] = pivot + factor * (pose[:3, 3] - pivot)
    return Camera.from_transform(pose, camera)


def panned(camera: Camera, pivot: Float[np.ndarray, "3"], x_px: float, y_px: float) -> Camera:
    """The camera moved so that the picture at the pivot's depth moves by so many pixels right and down."""
    pose = camera.world_from_camera.copy()
    depth = float((pose[:3, 3] - pivot) @ pose[:3, 2])
    pose[:3, 3] += depth * (-x_px / camera.fx * pose[:3, 0] + y_px / camera.fy * pose[:3, 1])
    return Camera.from_transform(pose, camera)


def seen_from(
    scene: RayScene, model: RelightModel, camera: Camera, image: UInt8[np.ndarray, "height width 3"]
) -> UInt8[np.ndarray, "rows columns 3"]:
    """A picture of the captured view, laid over the mesh and seen by another camera.

    Where the captured view did not see, there is a hatching.
    """
    points = points_seen(scene, model.mesh, camera)
    colors, known = _colors_at(model, points, image)
    rows, columns = np.divmod(points.pixel, camera.width)
    hatch = np.where(((rows + columns) // 3 % 2 == 0)[:, None], np.array(DULL), np.array(DULL) + 14)
    out = np.full((camera.num_pixels, 3), EMPTY, np.uint8)
    out[points.pixel] = np.rint(known * colors + (1 - known) * hatch).astype(np.uint8)
    return out.reshape(camera.height, camera.width, 3)


def vertex_colors(model: RelightModel, image: UInt8[np.ndarray, "height width 3"]) -> Float32[np.ndarray, "vertex 3"]:
    """What each vertex shows in a picture of the captured view, in [0, 1]; unseen ones their surface's mean colour."""
    mesh = model.mesh
    num = len(mesh.vertices)
    face = np.zeros(num, np.int32)
    face[mesh.faces.ravel()] = np.repeat(np.arange(len(mesh.faces), dtype=np.int32), 3)
    to_viewer = model.camera.center - mesh.vertices
    distance = np.linalg.norm(to_viewer, axis=1)
    to_viewer = (to_viewer / np.maximum(distance, 1e-12)[:, None]).astype(np.float32)
    points = ShadingPoints(
        pixel=np.zeros(num, np.int32),
        face=face,
        barycentric=np.full((num, 3), 1 / 3, np.float32),
        position=mesh.centered_vertices,
        geometric_normal=mesh.vertex_normals,
        normal=mesh.vertex_normals,
        to_viewer=to_viewer,
        depth=distance.astype(np.float32),
    )
    colors, known = _colors_at(model, points, image)
    mean = _surface_means(model, image)[model.surfaces.surface_of_face[face]]
    return ((known * colors + (1 - known) * mean) / 255.0).astype(np.float32)


def _colors_at(
    model: RelightModel, points: ShadingPoints, image: UInt8[np.ndarray, "height width 3"]
) -> tuple[Float[np.ndarray, "point 3"], Float[np.ndarray, "point 1"]]:
    """The captured picture where the points are in it, and how far it knows them (0 to 1)."""
    source, share = look_up(model, points)
    of_point = image.reshape(-1, 3)[model.pixels.points.pixel].astype(np.float32)
    total = share.sum(axis=1, keepdims=True)
    colors = np.einsum("pk,pkc->pc", share, of_point[np.maximum(source, 0)]) / np.maximum(total, 1e-6)
    return colors, np.clip(total, 0.0, 1.0)


def _surface_means(model: RelightModel, image: np.ndarray) -> Float[np.ndarray, "surface 3"]:
    of_point = image.reshape(-1, 3)[model.pixels.points.pixel].astype(np.float64)
    surface, num = model.pixels.surface, model.surfaces.num_surfaces
    count = np.bincount(surface, minlength=num)
    sums = np.stack([np.bincount(surface, of_point[:, c], minlength=num) for c in range(3)], axis=1)
    overall = of_point.mean(axis=0) if len(of_point) else np.zeros(3)
    return np.where(count[:, None] > 0, sums / np.maximum(count, 1)[:, None], overall)


def _rotation(axis: Float[np.ndarray, "3"], angle_rad: float) -> Float[np.ndarray, "3 3"]:
    """Rodrigues' formula; `axis` of unit length."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross


def _orthonormal(pose: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """The nearest rigid pose: thousands of small turns would add up."""
    u, _, vt = np.linalg.svd(pose[:3, :3])
    pose[:3, :3] = u @ vt
    return pose
