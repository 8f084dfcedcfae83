"""The mesh: parts with split normals and UVs, joined into one PLY with a face property `object_id`."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from desk.settings import Thing

PLY_VERTEX = np.dtype([(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v")])
PLY_FACE = np.dtype([("count", "u1"), ("vertex_indices", "<i4", 3), ("object_id", "<i4")])
# Each side of a box: its outward normal's axis and sign, and the axes along which u and v run (u x v points outward).
BOX_SIDES = ((0, 1, 1, 2), (0, -1, 1, 2), (1, 1, 0, 2), (1, -1, 0, 2), (2, 1, 0, 1), (2, -1, 0, 1))
ATLAS_COLUMNS, ATLAS_ROWS = 3, 2
ATLAS_INSET = 1 / 512  # half a texel, so that bilinear lookups stay in their cell


class Part(NamedTuple):
    points: np.ndarray  # (vertex, 3)
    normals: np.ndarray
    uvs: np.ndarray  # (vertex, 2)
    faces: np.ndarray  # (face, 3)


def join(parts: list[Part]) -> Part:
    starts = np.cumsum([0] + [len(part.points) for part in parts[:-1]])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)])
    return Part(*(np.concatenate([part[i] for part in parts]) for i in range(3)), faces)


def grid_faces(columns: int, rows: int) -> np.ndarray:
    """Two triangles a cell over (rows + 1) x (columns + 1) vertices, counter-clockwise for u right, v up."""
    row, column = np.mgrid[0:rows, 0:columns]
    low = (row * (columns + 1) + column).ravel()
    high = low + columns + 1
    return np.concatenate([np.stack([low, low + 1, high + 1], 1), np.stack([low, high + 1, high], 1)])


def box_side(side: int, size: np.ndarray, columns: int, rows: int) -> Part:
    """One side of a box whose foot is centred at the origin; UVs in the side's cell of the atlas."""
    axis, sign, u_axis, v_axis = BOX_SIDES[side]
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    u, v = u.ravel(), v.ravel()
    points = np.zeros((len(u), 3))
    # u turns over where needed so that u x v is the outward normal on every side.
    is_direct = np.linalg.det(np.eye(3)[[u_axis, v_axis, axis]]) * sign > 0
    points[:, u_axis] = (u if is_direct else 1 - u) - 0.5
    points[:, v_axis] = v - 0.5
    points[:, axis] = 0.5 * sign
    points = points * size + [0, 0, size[2] / 2]
    normals = np.zeros_like(points)
    normals[:, axis] = sign
    cell = np.stack([u, v], 1) * (1 - 2 * ATLAS_INSET) + ATLAS_INSET
    uvs = (cell + [side % ATLAS_COLUMNS, side // ATLAS_COLUMNS]) / [ATLAS_COLUMNS, ATLAS_ROWS]
    return Part(points, normals, uvs, grid_faces(columns, rows))


def box(size: np.ndarray, cells: int) -> Part:
    return join([box_side(side, size, cells, cells) for side in range(6)])


def slab(size: np.ndarray, cells: int) -> Part:
    """A table top: its upper face at z = 0 has all of the UV square, the other sides its corner (no relief there)."""
    sides = [box_side(side, size, cells, 1 if side < 4 else 2) for side in (0, 1, 2, 3, 5)]
    top = box_side(4, size, cells, round(cells * size[1] / size[0]))
    cell = (np.array([4 % ATLAS_COLUMNS, 4 // ATLAS_COLUMNS]) + ATLAS_INSET) / [ATLAS_COLUMNS, ATLAS_ROWS]
    top_uvs = (top.uvs - cell) / (1 - 2 * ATLAS_INSET) * [ATLAS_COLUMNS, ATLAS_ROWS]
    whole = join([top._replace(uvs=top_uvs)] + [side._replace(uvs=np.zeros_like(side.uvs)) for side in sides])
    return whole._replace(points=whole.points - [0, 0, size[2]])


def turned(radius_m: np.ndarray, height_m: np.ndarray, cells: int) -> Part:
    """A solid of revolution from its profile, foot to top; smooth normals of the profile, poles closed."""
    angle = np.linspace(0, 2 * np.pi, cells + 1)
    angle[-1] = 0.0  # the seam's two columns are the same points exactly
    slope_r, slope_z = np.gradient(radius_m), np.gradient(height_m)
    length = np.hypot(slope_r, slope_z)
    around = np.stack([np.cos(angle), np.sin(angle)], -1)
    rows = len(radius_m)
    points = np.concatenate(
        [radius_m[:, None, None] * around, np.broadcast_to(height_m[:, None, None], (rows, cells + 1, 1))], -1
    )
    across = (slope_z / length)[:, None, None] * around
    normals = np.concatenate([across, np.broadcast_to((-slope_r / length)[:, None, None], (rows, cells + 1, 1))], -1)
    v, u = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, cells + 1), indexing="ij")
    faces = grid_faces(cells, rows - 1)
    corners = points.reshape(-1, 3)[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1)
    return Part(points.reshape(-1, 3), normals.reshape(-1, 3), np.stack([u.ravel(), v.ravel()], 1), faces[area > 1e-12])


def sphere(size: np.ndarray, cells: int) -> Part:
    polar = np.linspace(0, np.pi, cells // 2 + 1)
    part = turned(np.abs(np.sin(polar)) * size[0] / 2, (1 - np.cos(polar)) * size[2] / 2, cells)
    outward = part.points - [0, 0, size[2] / 2]
    return part._replace(normals=outward / np.linalg.norm(outward, axis=1, keepdims=True))


def capsule(size: np.ndarray, cells: int) -> Part:
    radius = size[0] / 2
    polar = np.linspace(0, np.pi / 2, cells // 4 + 1)
    foot = np.stack([radius * np.sin(polar), radius * (1 - np.cos(polar))], 1)
    top = np.stack([foot[::-1, 0], size[2] - foot[::-1, 1]], 1)
    straight = np.linspace(foot[-1], top[0], 7)[1:-1]
    profile = np.concatenate([foot, straight, top])
    part = turned(np.abs(profile[:, 0]), profile[:, 1], cells)
    axis_z = np.clip(part.points[:, 2], radius, size[2] - radius)
    outward = part.points - np.stack([np.zeros_like(axis_z), np.zeros_like(axis_z), axis_z], 1)
    return part._replace(normals=outward / np.linalg.norm(outward, axis=1, keepdims=True))


# Radius and height of the vase, as shares of its full extents: foot, belly, neck, lip, and the dimple that closes it.
VASE_PROFILE = np.array([(0.48, 0.0), (0.84, 0.13), (1.0, 0.33), (0.84, 0.56), (0.50, 0.75), (0.40, 0.87),
                         (0.46, 0.965), (0.36, 1.0), (0.20, 0.985), (0.0, 0.975)])  # fmt: skip


def vase(size: np.ndarray, cells: int) -> Part:
    """Smooth everywhere; open at its foot, where it stands on the table."""
    profile = VASE_PROFILE * [size[0] / 2, size[2]]
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    curve = CubicSpline(along, profile)(np.linspace(0, along[-1], cells))
    return turned(np.maximum(curve[:, 0], 0), curve[:, 1], cells)


def panel_front(size: np.ndarray, cells: int) -> Part:
    part = box_side(3, size, cells, max(1, round(cells * size[2] / size[0])))
    return part._replace(points=part.points + [0, size[1] / 2, 0])


def panel_back(size: np.ndarray, cells: int) -> Part:
    whole = join(
        [box_side(side, size, cells if side == 2 else 1, cells if side == 2 else 1) for side in (0, 1, 2, 4, 5)]
    )
    return whole._replace(points=whole.points + [0, size[1] / 2, 0])


SHAPES = {"slab": slab, "box": box, "sphere": sphere, "vase": vase, "capsule": capsule,
          "panel_front": panel_front, "panel_back": panel_back}  # fmt: skip


def build(thing: Thing) -> Part:
    """The object in world coordinates."""
    part = SHAPES[thing.shape](np.array(thing.size, float), thing.cells)
    turn = np.deg2rad(thing.turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return part._replace(points=part.points @ rotation.T + thing.at, normals=part.normals @ rotation.T)


def write_ply(path: Path, parts: list[Part]) -> None:
    """Binary little-endian PLY; the object's id is its place in `parts`."""
    whole = join(parts)
    vertices = np.zeros(len(whole.points), PLY_VERTEX)
    for name, column in zip(PLY_VERTEX.names, np.concatenate(whole[:3], axis=1).T, strict=True):
        vertices[name] = column
    faces = np.zeros(len(whole.faces), PLY_FACE)
    faces["count"] = 3
    faces["vertex_indices"] = whole.faces
    faces["object_id"] = np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in PLY_VERTEX.names]
    header += [
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "property int object_id",
        "end_header",
        "",
    ]
    path.write_bytes("\n".join(header).encode() + vertices.tobytes() + faces.tobytes())


def read_ply(path: Path) -> list[Part]:
    """The parts of a file of `write_ply`: the renderer reads the very mesh that the folder holds."""
    header, body = path.read_bytes().split(b"end_header\n", 1)
    counts = [int(line.split()[2]) for line in header.decode().splitlines() if line.startswith("element")]
    vertices = np.frombuffer(body, PLY_VERTEX, counts[0])
    faces = np.frombuffer(body, PLY_FACE, counts[1], offset=vertices.nbytes)
    columns = np.stack([vertices[name] for name in PLY_VERTEX.names], 1)
    parts = []
    for object_id in range(faces["object_id"].max() + 1):
        used, corner = np.unique(faces["vertex_indices"][faces["object_id"] == object_id], return_inverse=True)
        mine = columns[used]
        parts.append(Part(mine[:, :3], mine[:, 3:6], mine[:, 6:], corner.reshape(-1, 3)))
    return parts
