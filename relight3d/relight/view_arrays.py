"""What the compiled loops of a new viewpoint write and read, in the order in which it flows. Vectors are planes.

A seat is a pixel's place when the picture is walked in blocks of 4 x 4 pixels, those that stick out of it included:
sixteen seats are a packet of rays. A rank is a pixel's place among those that have points.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32

NOTHING, SURROUNDINGS, AMONG_MIRRORS = -1, -2, -3  # in place of a face: how a ray ended that met none
ASKED = 0  # in place of the face of a ray that is to be traced
BLOCK = 4  # pixels along a block's side


class Mesh(NamedTuple):
    """What a ray's end is looked up in; coordinates are centred."""

    faces: Int32[np.ndarray, "face 3"]
    vertices: Float32[np.ndarray, "vertex 3"]
    vertex_normals: Float32[np.ndarray, "vertex 3"]
    face_normals: Float32[np.ndarray, "face 3"]
    surface_of_face: Int32[np.ndarray, " face"]


class Rays(NamedTuple):
    """Where rays end: one for each seat, then those of the pixels looked at again.

    `tint` and `turned` are written for rays that met a mirror, and read for no others.
    """

    face: Int32[np.ndarray, " ray"]
    label: Int32[np.ndarray, " ray"]  # 2 * surface + whether in a mirror; below 0 where no face is seen
    u: Float32[np.ndarray, " ray"]
    v: Float32[np.ndarray, " ray"]
    depth: Float32[np.ndarray, " ray"]  # the whole way
    toward: Float32[np.ndarray, "3 ray"]  # the last direction; at first the camera's
    normal: Float32[np.ndarray, "3 ray"]  # the mesh's shading normal there, 0 where no face is seen
    tint: Float32[np.ndarray, "ray 3"]  # what mirrors leave of light
    turned: Float32[np.ndarray, "ray 2 3"]  # how they turn the camera's steps to the right and down


class Picture(NamedTuple):
    """What outlines go by, row by row: the ends of the rays through the pixels' centres."""

    label: Int32[np.ndarray, " pixel"]
    depth: Float32[np.ndarray, " pixel"]
    normal: Float32[np.ndarray, "3 pixel"]
    is_hit: Bool[np.ndarray, " pixel"]
    is_edge: Bool[np.ndarray, " pixel"]


class Listed(NamedTuple):
    """The points by the rays that end in them, pixel by pixel, and the rays that a mirror sent to the surroundings."""

    ray: Int32[np.ndarray, " point"]
    part: Float32[np.ndarray, " point"]  # of its pixel
    rank_part: Float32[np.ndarray, " point"]  # the same, but only of what meets the mesh
    start: Int32[np.ndarray, " rank_and_end"]  # the points of rank r: start[r] to start[r + 1]
    pixel_of_rank: Int32[np.ndarray, " rank"]
    point_of_pixel: Int32[np.ndarray, " pixel"]  # -1 where there is none, or several
    lost: Int32[np.ndarray, " miss"]
    lost_part: Float32[np.ndarray, " miss"]
    lost_pixel: Int32[np.ndarray, " miss"]


class Captured(NamedTuple):
    """What every viewpoint of a model reads of its captured pixels."""

    row_of_pixel: Int32[np.ndarray, " pixel"]  # of a picture with a margin; where nothing was captured, an empty row
    seen: Float32[np.ndarray, " row_and_column"]  # PLACE_X and on, below; the last row is empty
    cell: Float32[np.ndarray, " pixel_and_column"]  # CELL_SURFACE and on; pixels as in row_of_pixel
    lens: Float64[np.ndarray, "8"]  # fx fy cx cy k1 k2 p1 p2
    frame: Float64[np.ndarray, "3 3"]  # the camera's axes, in columns
    eye: Float64[np.ndarray, "3"]
    size: Int32[np.ndarray, "2"]  # width and height
    vertex_albedo: Float32[np.ndarray, "vertex 3"]  # what stands in where no captured pixel knows


MARGIN = 2  # pixels around the captured picture
# Columns of a captured point's row, one cache line: place, how far it stands for others (in footprints of its pixel),
# normal, surface; then albedo, lobe gain, how far detail turns the normal, and one over the distance to the camera.
# Unsigned, like all that they are added to: an index that could be negative is asked about at every access.
PLACE_X, PLACE_Y, PLACE_Z, REACH, NORMAL_X, NORMAL_Y, NORMAL_Z, SURFACE = (np.uintp(k) for k in range(8))
ALBEDO_R, ALBEDO_G, ALBEDO_B, LOBE_GAIN, TILT_X, TILT_Y, TILT_Z, PER_DISTANCE = (np.uintp(k) for k in range(8, 16))
NUM_COLUMNS = np.uintp(16)
# What four neighbouring captured points (this one, right, below, both) have in common: their surface (-1 for none), how
# far they are from this one at most, the least of their reaches, and the cosine from which on a normal that makes it with
# this one's is alike to all four.
CELL_SURFACE, CELL_RADIUS, CELL_REACH, CELL_ALIKE, NUM_CELL_COLUMNS = (np.uintp(k) for k in range(5))


class Scratch(NamedTuple):
    """What a thread works in, for a chunk of points."""

    work: Float32[np.ndarray, "row point"]
    image: Float64[np.ndarray, "3 point"]
    known: Float32[np.ndarray, "point 8"]
    source: Int32[np.ndarray, "point 4"]
    share: Float32[np.ndarray, "point 4"]


class Told(NamedTuple):
    """What frames do not read of the points; the names are View's and ShadingPoints'."""

    face: Int32[np.ndarray, " point"]
    barycentric: Float32[np.ndarray, "point 3"]
    normal: Float32[np.ndarray, "point 3"]  # the mesh's
    depth: Float32[np.ndarray, " point"]
    albedo: Float32[np.ndarray, "point 3"]
    lobe_gain: Float32[np.ndarray, " point"]
    throughput: Float32[np.ndarray, "point 3"]
    is_mirrored: Bool[np.ndarray, " point"]
    source: Int32[np.ndarray, "point 4"]
    share: Float32[np.ndarray, "point 4"]


class Packed(NamedTuple):
    """What frames read of the points; parts that the model does not call for have length 0."""

    position: Float32[np.ndarray, "3 point"]
    geometric: Float32[np.ndarray, "3 point"]
    normal: Float32[np.ndarray, "3 point"]
    to_viewer: Float32[np.ndarray, "3 point"]
    diffuse: Float32[np.ndarray, "3 point"]  # albedo / pi * throughput
    gloss: Float32[np.ndarray, "3 point"]  # lobe gain * throughput
    surface: Int32[np.ndarray, " point"]
    neighbour: Int32[np.ndarray, "point 4"]
    corner: Int32[np.ndarray, "point 3"]  # the rows of `vertex` about each point, and their shares
    corner_share: Float32[np.ndarray, "point 3"]
    vertex: Int32[np.ndarray, " site"]  # the vertices that some point reads
    source: Int32[np.ndarray, "point 4"]  # captured points whose residual is read, and how far
    source_share: Float32[np.ndarray, "point 4"]
