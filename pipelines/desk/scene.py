"""The scene for Mitsuba: the folder's mesh, the surroundings, the camera (`variant.choose` comes first)."""

from pathlib import Path

import mitsuba as mi
import numpy as np

from desk.lamp_paths import MirrorPlane
from desk.lights import Lamp
from desk.patterns import painted_atlas, relief_normals
from desk.settings import Material, SceneSettings, Thing, View, Wall
from desk.shapes import read_ply, write_ply

LOBE_SHARE = 0.25  # how often a glossy surface is sampled by its lobe; both parts are scaled so that it changes nothing


def world_from_camera(view: View, turn_deg: float = 0.0) -> np.ndarray:
    """The contract's camera (x right, y up, looks down -z), turned about the vertical through its target."""
    turn = np.deg2rad(turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    target = np.array(view.target)
    eye = target + rotation @ (np.array(view.eye) - target)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    return matrix


def sensor(view: View, matrix: np.ndarray) -> dict:
    return {
        "type": "perspective",
        "fov": float(np.rad2deg(2 * np.arctan(view.width_px / 2 / view.focal_px))),
        "fov_axis": "x",
        "near_clip": 0.01,
        "far_clip": 100.0,
        # Mitsuba's camera has x to the left and looks along +z.
        "to_world": mi.ScalarTransform4f(matrix @ np.diag([-1.0, 1.0, -1.0, 1.0])),
        "film": {
            "type": "hdrfilm", "width": view.width_px, "height": view.height_px, "pixel_format": "rgb",
            "component_format": "float32", "rfilter": {"type": "box"}, "sample_border": False,
        },
        "sampler": {"type": "multijitter", "sample_count": 16},
    }  # fmt: skip


def rgb(color) -> dict:
    return {"type": "rgb", "value": [float(c) for c in color]}


def image(values: np.ndarray) -> dict:
    """A texture; row 0 is at v = 0."""
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(values.astype(np.float32)),
        "raw": True,
        "filter_type": "bilinear",
        "wrap_mode": "clamp",
    }


def bsdf(material: Material, thing: Thing, settings: SceneSettings) -> dict:
    if material.kind == "mirror":
        return {"type": "conductor", "material": "none", "specular_reflectance": rgb(material.mirror_reflectance)}
    if material.kind == "textured":
        return {"type": "diffuse", "reflectance": image(painted_atlas(material.albedo))}
    if material.kind == "diffuse":
        return {"type": "diffuse", "reflectance": rgb(material.albedo)}
    lobe = {
        "type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": material.lobe_alpha,
        "specular_reflectance": rgb([material.lobe_reflectance / LOBE_SHARE] * 3),
    }  # fmt: skip
    body = {"type": "diffuse", "reflectance": rgb(np.array(material.albedo) / (1 - LOBE_SHARE))}
    both = {"type": "blendbsdf", "weight": LOBE_SHARE, "body": body, "lobe": lobe}
    if not material.has_relief:
        return both
    normals = relief_normals(settings.relief, thing.size[:2])
    return {"type": "normalmap", "normalmap": image(normals / 2 + 0.5), "bsdf": both}


def wall_shape(wall: Wall, is_lit: bool) -> dict:
    half_u, half_v = np.array(wall.half_u, float), np.array(wall.half_v, float)
    normal = np.cross(half_u, half_v) / np.linalg.norm(np.cross(half_u, half_v))
    matrix = np.eye(4)
    matrix[:3] = np.stack([half_u, half_v, normal, wall.middle], axis=1)
    shape = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(matrix),
        "bsdf": {"type": "diffuse", "reflectance": rgb(wall.albedo)},
    }
    if is_lit and any(wall.radiance):
        shape["emitter"] = {"type": "area", "radiance": rgb(wall.radiance)}
    return shape


def lamp_emitter(lamp: Lamp) -> dict:
    if lamp.position is not None:
        return {"type": "point", "position": list(lamp.position), "intensity": rgb((1, 1, 1))}
    return {"type": "directional", "direction": [-c for c in lamp.to_light], "irradiance": rgb((1, 1, 1))}


def load_scene(settings: SceneSettings, mesh_path: Path, camera: np.ndarray, lamp: Lamp | None, work: Path):
    """With a lamp: that lamp alone, the room's emitters off. Without: the lights-off scene."""
    scene = {"type": "scene", "camera": sensor(settings.view, camera)}
    if lamp is not None:
        scene["lamp"] = lamp_emitter(lamp)
    for i, (thing, part) in enumerate(zip(settings.things, read_ply(mesh_path), strict=True)):
        alone = work / f"{settings.name}_{i}.ply"  # Mitsuba takes one material a file
        if not alone.exists():
            write_ply(alone, [part])
        scene[f"thing_{i:02d}"] = {"type": "ply", "filename": str(alone), "bsdf": bsdf(thing.material, thing, settings)}
    for wall in settings.walls:
        scene[f"wall_{wall.name}"] = wall_shape(wall, is_lit=lamp is None)
    return mi.load_dict(scene)


def mirror_plane(settings: SceneSettings) -> MirrorPlane | None:
    """The scene's plane mirror, from its settings; at most one."""
    for thing in settings.things:
        if thing.shape == "panel_front":
            turn = np.deg2rad(thing.turn_deg)
            axis_u = np.array([np.cos(turn), np.sin(turn), 0.0])
            normal = np.array([np.sin(turn), -np.cos(turn), 0.0])
            middle = np.array(thing.at, float) + [0, 0, thing.size[2] / 2]
            halves = thing.size[0] / 2, thing.size[2] / 2
            return MirrorPlane(
                middle, normal, axis_u, np.array([0.0, 0, 1]), *halves, np.array(thing.material.mirror_reflectance)
            )
    return None
