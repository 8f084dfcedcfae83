"""What the captured pixels know about points seen from elsewhere, chunk by chunk: helpers of view_kernels.

They compute views.look_up, views.read and forward.residual_source. Within a chunk of points a..b the workspace counts
from 0.
"""

import math

import numpy as np

from relight3d.relight.kernels import ONE, ONE_ON, ZERO, inlined
from relight3d.relight.view_arrays import (
    ALBEDO_B,
    ALBEDO_G,
    ALBEDO_R,
    CELL_ALIKE,
    CELL_RADIUS,
    CELL_REACH,
    CELL_SURFACE,
    LOBE_GAIN,
    MARGIN,
    NORMAL_X,
    NORMAL_Y,
    NORMAL_Z,
    NUM_CELL_COLUMNS,
    NUM_COLUMNS,
    PER_DISTANCE,
    PLACE_X,
    PLACE_Y,
    PLACE_Z,
    REACH,
    SURFACE,
    TILT_X,
    TILT_Y,
    TILT_Z,
)

# Rows of a chunk's workspace: the mesh's normal; what captured pixels know: albedo, lobe gain, turn of the normal, how
# far they do not know, how far their residual holds from here, and how much of it the point's pixel shows.
MESH_NORMAL, ALBEDO, GAIN, TILT, REST, FADE, HELD, NUM_WORK_ROWS = 0, 3, 6, 7, 10, 11, 12, 13
NEAR_RAD, FAR_RAD = math.radians(8), math.radians(30)  # a residual fades between
NEAR, FAR = np.float32(math.cos(NEAR_RAD)), np.float32(math.cos(FAR_RAD))
PER_FADE, UNSURE = np.float32(1 / (NEAR - FAR)), np.float32(-1)
ALIKE = np.float32(0.7)  # cosine between the normals of one spot
OUTSIDE = 1.5  # pixels: so far left of the picture, or above, stands what is not in it


@inlined
def project(a, b, captured, position, image):
    """Camera.project: image x and y less half a pixel, and depth along the axis; outside of the picture for the unseen."""
    lens, frame, eye = captured.lens, captured.frame, captured.eye
    x, y, z = position[0, a:b], position[1, a:b], position[2, a:b]
    column, row, depth = image[0, : b - a], image[1, : b - a], image[2, : b - a]
    for i in range(len(x)):
        px, py, pz = x[i] - eye[0], y[i] - eye[1], z[i] - eye[2]
        column[i] = px * frame[0, 0] + py * frame[1, 0] + pz * frame[2, 0]
        row[i] = px * frame[0, 1] + py * frame[1, 1] + pz * frame[2, 1]
        depth[i] = -(px * frame[0, 2] + py * frame[1, 2] + pz * frame[2, 2])
    most_x, most_y = captured.size[0] + 0.25, captured.size[1] + 0.25
    for i in range(len(x)):
        inverse = 1.0 / depth[i]
        ix, iy = column[i] * inverse, -row[i] * inverse
        r2 = ix * ix + iy * iy
        radial = 1.0 + r2 * (lens[4] + r2 * lens[5])
        dx = ix * radial + 2 * lens[6] * ix * iy + lens[7] * (r2 + 2 * ix * ix)
        dy = iy * radial + lens[6] * (r2 + 2 * iy * iy) + 2 * lens[7] * ix * iy
        dx, dy = dx * lens[0] + lens[2] - 0.5, dy * lens[1] + lens[3] - 0.5
        is_near = (depth[i] > 0) & (dx > -OUTSIDE) & (dy > -OUTSIDE)
        column[i] = min(dx, most_x) if is_near else -OUTSIDE
        row[i] = min(dy, most_y) if is_near else -OUTSIDE


@inlined
def fades(a, b, captured, packed, fade):
    """How far the captured residual holds at points a..b, by the angle between both ways of seeing them: 1 up to 8
    degrees, 0 from 30 on, and between the two UNSURE, since each captured pixel has its own angle.
    """
    ex, ey, ez = np.float32(captured.eye[0]), np.float32(captured.eye[1]), np.float32(captured.eye[2])
    # Two pixels as seen from the captured camera: the pixels about a point's image lie nearer.
    off = 2 / min(captured.lens[0], captured.lens[1])
    surely, never = np.float32(math.cos(max(NEAR_RAD - off, 0.0))), np.float32(math.cos(FAR_RAD + off))
    x, y, z, out = packed.position[0, a:b], packed.position[1, a:b], packed.position[2, a:b], fade[: b - a]
    vx, vy, vz = packed.to_viewer[0, a:b], packed.to_viewer[1, a:b], packed.to_viewer[2, a:b]
    for i in range(b - a):
        dx, dy, dz = ex - x[i], ey - y[i], ez - z[i]
        length = np.float32(math.sqrt(dx * dx + dy * dy + dz * dz))
        along = dx * vx[i] + dy * vy[i] + dz * vz[i]
        out[i] = ONE if along > surely * length else (ZERO if along < never * length else UNSURE)


@inlined
def _part(seen, row, surface, p, n, footprint):
    """1 where a captured point, which begins at `row` of `seen`, shows the spot at p with normal n; else 0."""
    if seen[row + SURFACE] != surface:
        return ZERO
    dx, dy, dz = seen[row + PLACE_X] - p[0], seen[row + PLACE_Y] - p[1], seen[row + PLACE_Z] - p[2]
    reach = footprint * seen[row + REACH]
    alike = seen[row + NORMAL_X] * n[0] + seen[row + NORMAL_Y] * n[1] + seen[row + NORMAL_Z] * n[2]
    return ONE if (alike > ALIKE) & (dx * dx + dy * dy + dz * dz < reach * reach) else ZERO


@inlined
def _are_alike(cell, at, seen, row, surface, p, n, footprint):
    """Whether all four captured points about a place surely show the spot at p (view_arrays.CELL_SURFACE and on)."""
    dx, dy, dz = seen[row + PLACE_X] - p[0], seen[row + PLACE_Y] - p[1], seen[row + PLACE_Z] - p[2]
    room = footprint * cell[at + CELL_REACH] - cell[at + CELL_RADIUS]
    alike = seen[row + NORMAL_X] * n[0] + seen[row + NORMAL_Y] * n[1] + seen[row + NORMAL_Z] * n[2]
    near = (room > ZERO) & (dx * dx + dy * dy + dz * dz < room * room)
    return near & (cell[at + CELL_SURFACE] == surface) & (alike > cell[at + CELL_ALIKE])


@inlined
def _fade(seen, row, eye, v):
    """How far a captured pixel's residual holds from the direction v (forward.residual_source)."""
    dx, dy, dz = eye[0] - seen[row + PLACE_X], eye[1] - seen[row + PLACE_Y], eye[2] - seen[row + PLACE_Z]
    cosine = (dx * v[0] + dy * v[1] + dz * v[2]) * seen[row + PER_DISTANCE]
    return min(max((cosine - FAR) * PER_FADE, ZERO), ONE)


@inlined
def _mean(seen, w, r, column):
    """A column of four captured points, by their weights."""
    return (
        w[0] * seen[r[0] + column] + w[1] * seen[r[1] + column]
        + w[2] * seen[r[2] + column] + w[3] * seen[r[3] + column]
    )  # fmt: skip


@inlined
def read_captured(a, b, captured, packed, scratch, source, share, out):
    """views.look_up for points a..b, and what the captured pixels found know.

    `source` and `share` are written from row `out` on: any captured point with a share of 0 where none shows the spot;
    shares as far as rows HELD and FADE of the workspace let them.
    """
    seen, cell, row_of_pixel = captured.seen, captured.cell, captured.row_of_pixel
    work, image, known = scratch.work, scratch.image, scratch.known
    eye = (np.float32(captured.eye[0]), np.float32(captured.eye[1]), np.float32(captured.eye[2]))
    most = np.int32(len(seen) // 16 - 2)
    per_focal, stride = 1.0 / min(captured.lens[0], captured.lens[1]), np.uintp(captured.size[0] + 2 * MARGIN)
    position, to_viewer = packed.position, packed.to_viewer
    for i in range(b - a):
        left, top = np.floor(image[0, i]), np.floor(image[1, i])
        x, y = np.float32(image[0, i] - left), np.float32(image[1, i] - top)
        footprint, surface = np.float32(max(image[2, i], 0.0) * per_focal), np.float32(packed.surface[a + i])
        at = np.uintp(int(top) + MARGIN) * stride + np.uintp(int(left) + MARGIN)
        m0, m1 = row_of_pixel[at], row_of_pixel[at + ONE_ON]
        m2, m3 = row_of_pixel[at + stride], row_of_pixel[at + stride + ONE_ON]
        r = (
            np.uintp(m0) * NUM_COLUMNS, np.uintp(m1) * NUM_COLUMNS, np.uintp(m2) * NUM_COLUMNS,
            np.uintp(m3) * NUM_COLUMNS,
        )  # fmt: skip
        p = (position[0, a + i], position[1, a + i], position[2, a + i])
        n = (work[MESH_NORMAL, i], work[MESH_NORMAL + 1, i], work[MESH_NORMAL + 2, i])
        w0, w1, w2, w3 = (ONE - x) * (ONE - y), x * (ONE - y), (ONE - x) * y, x * y
        rest = ZERO
        if not _are_alike(cell, at * NUM_CELL_COLUMNS, seen, r[0], surface, p, n, footprint):
            w0 *= _part(seen, r[0], surface, p, n, footprint)
            w1 *= _part(seen, r[1], surface, p, n, footprint)
            w2 *= _part(seen, r[2], surface, p, n, footprint)
            w3 *= _part(seen, r[3], surface, p, n, footprint)
            total = w0 + w1 + w2 + w3
            inverse = ONE / max(total, np.float32(0.25))
            w0, w1, w2, w3, rest = w0 * inverse, w1 * inverse, w2 * inverse, w3 * inverse, ONE - total * inverse
        w = (w0, w1, w2, w3)
        # All columns are read before any is written: so they are taken together, in one vector register.
        red, green, blue = _mean(seen, w, r, ALBEDO_R), _mean(seen, w, r, ALBEDO_G), _mean(seen, w, r, ALBEDO_B)
        gain, tx = _mean(seen, w, r, LOBE_GAIN), _mean(seen, w, r, TILT_X)
        ty, tz, last = _mean(seen, w, r, TILT_Y), _mean(seen, w, r, TILT_Z), _mean(seen, w, r, PER_DISTANCE)
        known[i, 0], known[i, 1], known[i, 2], known[i, 3] = red, green, blue, gain
        known[i, 4], known[i, 5], known[i, 6], known[i, 7] = tx, ty, tz, last
        work[REST, i] = max(rest, ZERO)
        held, fade = work[HELD, i], work[FADE, i]
        f0, f1, f2, f3 = held * fade, held * fade, held * fade, held * fade
        if fade == UNSURE:
            v = (to_viewer[0, a + i], to_viewer[1, a + i], to_viewer[2, a + i])
            f0, f1 = held * _fade(seen, r[0], eye, v), held * _fade(seen, r[1], eye, v)
            f2, f3 = held * _fade(seen, r[2], eye, v), held * _fade(seen, r[3], eye, v)
        source[out + i, 0], source[out + i, 1] = min(m0, most), min(m1, most)
        source[out + i, 2], source[out + i, 3] = min(m2, most), min(m3, most)
        f0, f1, f2, f3 = w0 * f0, w1 * f1, w2 * f2, w3 * f3
        share[out + i, 0], share[out + i, 1], share[out + i, 2], share[out + i, 3] = f0, f1, f2, f3
