"""Relit frames as pictures: 8-bit display values, files, and the same through Open3D's renderer.

The display values are computed here, and Open3D hands them through bit by bit (LIBRARIES: its own tone mapping, sRGB
decoding and dithering are all avoided). So where it cannot draw, the same pixels come without it.
"""

import logging
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int32, UInt8

from relight3d.camera import Camera
from relight3d.display.offscreen import Offscreen, shared_offscreen
from relight3d.errors import DisplayError, InputError
from relight3d.io.images import write_exr, write_png
from relight3d.maths.color import display_u8
from relight3d.records import Frame, PatchMesh
from relight3d.shading import points_seen, ray_scene

log = logging.getLogger("relight3d")

Picture = UInt8[np.ndarray, "height width 3"]


def show_frame_u8(frame: Frame | np.ndarray, exposure: float | None = None) -> Picture:
    """8-bit sRGB values of a frame, or of linear radiance, under one exposure (the frame's own by default)."""
    radiance = frame.radiance if isinstance(frame, Frame) else frame
    own = frame.exposure if isinstance(frame, Frame) else 1.0
    return display_u8(radiance, own if exposure is None else exposure)


def render_open3d(
    frame: Frame | np.ndarray, exposure: float | None = None, renderer: Offscreen | None = None
) -> Picture:
    """`show_frame_u8` shown by Open3D's offscreen renderer and read back: the same pixels, with it or without.

    Safe to call from any thread and beside an open window. `renderer` keeps a long sequence apart from others'.
    """
    pixels = show_frame_u8(frame, exposure)
    try:
        return (renderer or shared_offscreen()).render(pixels=pixels)
    except DisplayError as error:
        log.info("%s; the picture is made without it", error)
        return pixels


def render_mesh(
    mesh: PatchMesh,
    colors: Float32[np.ndarray, "vertex 3"],
    camera: Camera,
    renderer: Offscreen | None = None,
) -> Picture:
    """A quick view of the mesh from any camera: display values at its vertices, blended over each face.

    Lens distortion is left out. Where Open3D cannot draw, rays do; only pixels on outlines may differ.
    """
    colors = np.clip(np.nan_to_num(colors), 0.0, 1.0).astype(np.float32)
    intrinsics, pose, clip = opencv_camera(camera, mesh)
    try:
        return (renderer or shared_offscreen()).render(
            vertices=mesh.centered_vertices,
            faces=mesh.faces,
            colors=colors,
            normals=mesh.vertex_normals,
            intrinsics=intrinsics,
            pose=pose,
            clip=np.array(clip),
            size=np.array([camera.width, camera.height]),
        )
    except DisplayError as error:
        log.info("%s; the mesh is drawn without it", error)
        return _ray_cast_mesh(mesh, colors, camera)


def opencv_camera(camera: Camera, mesh: PatchMesh) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """K, camera_from_centred-world with OpenCV's axes (y down, z ahead), and clip planes about the mesh."""
    intrinsics = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    centred = camera.translated(-mesh.center).world_from_camera @ np.diag([1.0, -1.0, -1.0, 1.0])
    distance = float(np.linalg.norm(camera.center - mesh.center))
    # A depth buffer's digits lie near the camera: the near plane stays within four digits of the far one.
    far = distance + 1.01 * mesh.radius
    return intrinsics, np.linalg.inv(centred), (max(distance - 1.01 * mesh.radius, 1e-3 * far), far)


def write_frame(path: str | Path, frame: Frame | np.ndarray, exposure: float | None = None) -> None:
    """Write linear radiance (.exr) or display values (.png), by the name. Raises InputError for another."""
    suffix = Path(path).suffix.lower()
    if suffix == ".exr":
        write_exr(path, frame.radiance if isinstance(frame, Frame) else frame)
    elif suffix == ".png":
        write_png(path, show_frame_u8(frame, exposure))
    else:
        raise InputError("output", str(path), "a name that ends in .png or .exr")


def _ray_cast_mesh(mesh: PatchMesh, colors: Float32[np.ndarray, "vertex 3"], camera: Camera) -> Picture:
    points = points_seen(ray_scene(mesh), mesh, camera)
    corners: Int32[np.ndarray, "point 3"] = mesh.faces[points.face]
    values = np.einsum("pk,pkc->pc", points.barycentric, colors[corners])
    picture = np.zeros((camera.num_pixels, 3), np.uint8)
    picture[points.pixel] = np.rint(values * 255)
    return picture.reshape(camera.height, camera.width, 3)
