"""The compiled loops of a new viewpoint: what its points are, and what the captured pixels know about them.

They compute what shading.py and views.py compute, point by point. Vectors of points are planes (3 x point).
"""

import math

import numpy as np

from relight3d.relight.kernels import ONE, ZERO, compiled, inlined
from relight3d.relight.look_kernels import surface_point

# Columns of a captured point's row, one cache line: place, how far it stands for others (in footprints of its pixel),
# normal, surface; then albedo, lobe gain, and how far detail turns the normal.
SEEN_PLACE, SEEN_REACH, SEEN_NORMAL, SEEN_SURFACE, SEEN_ALBEDO, SEEN_GAIN, SEEN_TILT, SEEN_COLUMNS = (
    0, 3, 4, 7, 8, 11, 12, 16,
)  # fmt: skip


@compiled
def place_points(
    first, last, ray_of_point, part, face, u, v, depth, toward, bounces, tint, mesh, surface_of_face, out_face,
    barycentric, position, geometric, normal, to_viewer, out_depth, surface, is_mirrored, throughput,
):  # fmt: skip
    """Points first..last where rays end (look_kernels.look); each has a `part` of its pixel."""
    for p in range(first, last):
        ray = ray_of_point[p]
        f, b, c = face[ray], u[ray], v[ray]
        out_face[p], out_depth[p], surface[p], is_mirrored[p] = f, depth[ray], surface_of_face[f], bounces[ray] > 0
        barycentric[p, 0], barycentric[p, 1], barycentric[p, 2] = ONE - b - c, b, c
        wx, wy, wz = toward[ray, 0], toward[ray, 1], toward[ray, 2]
        to_viewer[0, p], to_viewer[1, p], to_viewer[2, p] = -wx, -wy, -wz
        px, py, pz, gx, gy, gz, nx, ny, nz = surface_point(f, b, c, wx, wy, wz, *mesh)
        position[0, p], position[1, p], position[2, p] = px, py, pz
        geometric[0, p], geometric[1, p], geometric[2, p] = gx, gy, gz
        normal[0, p], normal[1, p], normal[2, p] = nx, ny, nz
        for axis in range(3):
            throughput[axis, p] = part[p] * tint[ray, axis]


@inlined
def _image_point(lens, frame, center, x, y, z):
    """Camera.project for one point: image x and y, depth along the axis (<= 0 behind the camera)."""
    px, py, pz = x - center[0], y - center[1], z - center[2]
    cx = px * frame[0, 0] + py * frame[1, 0] + pz * frame[2, 0]
    cy = px * frame[0, 1] + py * frame[1, 1] + pz * frame[2, 1]
    depth = -(px * frame[0, 2] + py * frame[1, 2] + pz * frame[2, 2])
    if not depth > 0:
        return -10.0, -10.0, depth
    ix, iy = cx / depth, -cy / depth
    r2 = ix * ix + iy * iy
    radial = 1.0 + r2 * (lens[4] + r2 * lens[5])
    dx = ix * radial + 2 * lens[6] * ix * iy + lens[7] * (r2 + 2 * ix * ix)
    dy = iy * radial + lens[6] * (r2 + 2 * iy * iy) + 2 * lens[7] * ix * iy
    return dx * lens[0] + lens[2], dy * lens[1] + lens[3], depth


@compiled
def look_up(
    first, last, lens, frame, center, width, height, row_of_pixel, seen, position, normal, surface, source, share
):
    """views.look_up for points first..last; `seen` are the captured points, a row each (SEEN_PLACE and on)."""
    for p in range(first, last):
        x, y, depth = _image_point(lens, frame, center, position[0, p], position[1, p], position[2, p])
        x, y = min(max(x, -10.0), width + height + 10.0) - 0.5, min(max(y, -10.0), width + height + 10.0) - 0.5
        left, top = int(np.floor(x)), int(np.floor(y))
        right_part, lower_part = np.float32(x - left), np.float32(y - top)
        footprint, total = np.float32(max(depth, 0.0) / min(lens[0], lens[1])), ZERO
        for k in range(4):
            column, row = left + (k & 1), top + (k >> 1)
            source[p, k], share[p, k] = -1, ZERO
            if column < 0 or column >= width or row < 0 or row >= height or not depth > 0:
                continue
            found = row_of_pixel[row * width + column]
            if found < 0 or seen[found, SEEN_SURFACE] != surface[p]:
                continue
            dx = seen[found, SEEN_PLACE] - position[0, p]
            dy = seen[found, SEEN_PLACE + 1] - position[1, p]
            dz = seen[found, SEEN_PLACE + 2] - position[2, p]
            reach = footprint * seen[found, SEEN_REACH]
            alike = seen[found, SEEN_NORMAL] * normal[0, p] + seen[found, SEEN_NORMAL + 1] * normal[1, p]
            alike += seen[found, SEEN_NORMAL + 2] * normal[2, p]
            if dx * dx + dy * dy + dz * dz < reach * reach and alike > np.float32(0.7):
                weight = right_part if k & 1 else ONE - right_part
                weight *= lower_part if k >> 1 else ONE - lower_part
                source[p, k], share[p, k] = found, weight
                total += weight
        inverse = ONE / max(total, np.float32(0.25))
        for k in range(4):
            share[p, k] *= inverse


@compiled
def read_properties(first, last, source, share, surface, mean, seen, point_normal, albedo, normal, gain):
    """Albedo, normal and lobe gain of points first..last: the captured pixels' as far as they know, else the mean's."""
    for p in range(first, last):
        known = share[p, 0] + share[p, 1] + share[p, 2] + share[p, 3]
        rest = ONE - min(max(known, ZERO), ONE)
        strength = rest
        red, green, blue = rest * mean[surface[p], 0], rest * mean[surface[p], 1], rest * mean[surface[p], 2]
        nx, ny, nz = point_normal[0, p], point_normal[1, p], point_normal[2, p]
        for k in range(4):
            if share[p, k] > 0:
                row, weight = source[p, k], share[p, k]
                red += weight * seen[row, SEEN_ALBEDO]
                green += weight * seen[row, SEEN_ALBEDO + 1]
                blue += weight * seen[row, SEEN_ALBEDO + 2]
                strength += weight * seen[row, SEEN_GAIN]
                nx += weight * seen[row, SEEN_TILT]
                ny += weight * seen[row, SEEN_TILT + 1]
                nz += weight * seen[row, SEEN_TILT + 2]
        inverse = ONE / max(np.float32(math.sqrt(nx * nx + ny * ny + nz * nz)), np.float32(1e-6))
        albedo[0, p], albedo[1, p], albedo[2, p], gain[p] = red, green, blue, strength
        normal[0, p], normal[1, p], normal[2, p] = nx * inverse, ny * inverse, nz * inverse


@compiled
def steps(first, last, ways, ray_of_point, bounces, turned, geometric, to_viewer, depth, step):
    """views._steps for points first..last; `ways` are the camera's, which mirrors have `turned`."""
    for p in range(first, last):
        ray, facing = ray_of_point[p], ZERO
        for axis in range(3):
            facing -= geometric[axis, p] * to_viewer[axis, p]
        facing = min(facing, np.float32(-0.08))
        for k in range(2):
            slide = ZERO
            for axis in range(3):
                way = turned[ray, k, axis] if bounces[ray] > 0 else ways[k, axis]
                step[p, k, axis] = way * depth[p]
                slide += geometric[axis, p] * step[p, k, axis]
            for axis in range(3):
                step[p, k, axis] += slide / facing * to_viewer[axis, p]


@compiled
def mark_whole(first, last, pixel, is_cut, point_of_pixel):
    """point_of_pixel[pixel] = the point of each pixel that is not cut, for points first..last."""
    for p in range(first, last):
        if not is_cut[pixel[p]]:
            point_of_pixel[pixel[p]] = p


@compiled
def neighbours(first, last, width, height, pixel, point_of_pixel, surface, is_mirrored, neighbour):
    """views._neighbours for points first..last; `point_of_pixel` is -1 for pixels cut into several points."""
    for p in range(first, last):
        column, row = pixel[p] % width, pixel[p] // width
        for k in range(4):
            x, y = column + (k == 0) - (k == 1), row + (k == 2) - (k == 3)
            neighbour[p, k] = -1
            if 0 <= x < width and 0 <= y < height and point_of_pixel[pixel[p]] >= 0:
                other = point_of_pixel[y * width + x]
                if other >= 0 and surface[other] == surface[p] and is_mirrored[other] == is_mirrored[p]:
                    neighbour[p, k] = other


@compiled
def fade_shares(
    first, last, order, source, share, seen_viewer, to_viewer, is_mirrored, rank_share, out_source, out_share
):
    """forward.residual_source away from the captured view, for the points order[first..last]: faded where the spot is
    seen from another side than it was photographed (between 8 and 30 degrees), and by `rank_share`, the point's of its
    pixel's points.
    """
    near, far = np.float32(math.cos(math.radians(8))), np.float32(math.cos(math.radians(30)))
    for q in range(first, last):
        p = order[q]
        for k in range(4):
            there = max(source[p, k], 0)
            out_source[q, k], out_share[q, k] = there, 0
            if share[p, k] > 0 and not is_mirrored[p]:
                alike = ZERO
                for axis in range(3):
                    alike += seen_viewer[there, axis] * to_viewer[axis, q]
                fade = min(max((alike - far) / (near - far), ZERO), ONE)
                out_share[q, k] = share[p, k] * fade * rank_share[q]


@compiled
def pack_reflectance(first, last, order, albedo, throughput, gain, diffuse, gloss):
    """albedo / pi * throughput and lobe gain * throughput of the points order[first..last]; all planes."""
    per_pi = np.float32(1 / math.pi)
    for axis in range(3):
        for q in range(first, last):
            p = order[q]
            diffuse[axis, q] = albedo[axis, p] * throughput[axis, p] * per_pi
            gloss[axis, q] = gain[p] * throughput[axis, p]


@compiled
def number_used(source, new_row, rows):
    """Numbers the rows that `source` reads, in their order: writes them to `rows`, and to `source` their new numbers.

    `new_row`: as many zeros as there are rows. Returns how many are read.
    """
    for p in range(source.shape[0]):
        for k in range(source.shape[1]):
            new_row[source[p, k]] = 1
    count = 0
    for row in range(len(new_row)):
        if new_row[row] > 0:
            rows[count], new_row[row] = row, count
            count += 1
    for p in range(source.shape[0]):
        for k in range(source.shape[1]):
            source[p, k] = new_row[source[p, k]]
    return count


@compiled
def read_faces(first, last, order, face, faces, source):
    """The corners of the faces of points order[first..last]."""
    for q in range(first, last):
        for k in range(3):
            source[q, k] = faces[face[order[q]], k]
