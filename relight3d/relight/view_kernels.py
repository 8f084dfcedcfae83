"""The compiled loops of a new viewpoint: rays to points, and what the captured pixels know about them.

They compute what shading.py and views.py compute, point by point.
"""

import math

import numpy as np

from relight3d.relight.kernels import ONE, ZERO, compiled, inlined


@compiled
def pixel_rays(first, last, corner, right, down, width, directions):
    """Unit directions through the centres of pixels first..last of a camera without distortion."""
    for pixel in range(first, last):
        x, y = pixel % width + 0.5, pixel // width + 0.5
        dx = corner[0] + x * right[0] + y * down[0]
        dy = corner[1] + x * right[1] + y * down[1]
        dz = corner[2] + x * right[2] + y * down[2]
        inverse = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
        directions[pixel, 0], directions[pixel, 1], directions[pixel, 2] = dx * inverse, dy * inverse, dz * inverse


@compiled
def points_at_hits(
    first, last, hit, face, u, v, distance, directions, way, faces, vertices, vertex_normals, face_normals,
    barycentric, position, geometric, normal, to_viewer, depth,
):  # fmt: skip
    """shading._points_along for the rays hit[first..last]; `way` (length 0 for none) is the way before the ray."""
    for p in range(first, last):
        ray = hit[p]
        f = face[ray]
        a, b, c = ONE - u[ray] - v[ray], u[ray], v[ray]
        barycentric[p, 0], barycentric[p, 1], barycentric[p, 2] = a, b, c
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        turned, length = ZERO, ZERO
        for axis in range(3):
            to_viewer[p, axis] = -directions[ray, axis]
            position[p, axis] = a * vertices[i, axis] + b * vertices[j, axis] + c * vertices[k, axis]
            turned += face_normals[f, axis] * to_viewer[p, axis]
            normal[p, axis] = a * vertex_normals[i, axis] + b * vertex_normals[j, axis] + c * vertex_normals[k, axis]
            length += normal[p, axis] * normal[p, axis]
        side = -ONE if turned < 0 else ONE
        inverse, along = ONE / max(np.float32(math.sqrt(length)), np.float32(1e-6)), ZERO
        for axis in range(3):
            geometric[p, axis] = side * face_normals[f, axis]
            normal[p, axis] = normal[p, axis] * inverse if length > 1e-12 else geometric[p, axis]
            along += normal[p, axis] * geometric[p, axis]
        if along < 0:
            for axis in range(3):
                normal[p, axis] = -normal[p, axis]
        depth[p] = distance[ray] + (way[ray] if len(way) else ZERO)


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
    first, last, lens, frame, center, width, height, row_of_pixel, seen_position, seen_geometric, seen_viewer,
    seen_normal, seen_surface, position, normal, surface, source, share,
):  # fmt: skip
    """views.look_up for points first..last."""
    for p in range(first, last):
        x, y, depth = _image_point(lens, frame, center, position[p, 0], position[p, 1], position[p, 2])
        x, y = min(max(x, -10.0), width + height + 10.0) - 0.5, min(max(y, -10.0), width + height + 10.0) - 0.5
        left, top = math.floor(x), math.floor(y)
        footprint, total = max(depth, 0.0) / min(lens[0], lens[1]), 0.0
        for k in range(4):
            source[p, k], share[p, k] = -1, 0
            column, row = int(left) + k % 2, int(top) + k // 2
            if not (0 <= column < width and 0 <= row < height and depth > 0):
                continue
            found = row_of_pixel[row * width + column]
            if found < 0 or seen_surface[found] != surface[p]:
                continue
            apart, slant, alike = 0.0, 0.0, 0.0
            for axis in range(3):
                apart += (seen_position[found, axis] - position[p, axis]) ** 2
                slant += seen_geometric[found, axis] * seen_viewer[found, axis]
                alike += seen_normal[found, axis] * normal[p, axis]
            if math.sqrt(apart) < 3.0 * footprint / max(abs(slant), 0.1) and alike > 0.7:
                weight = (x - left if k % 2 else 1 - x + left) * (y - top if k // 2 else 1 - y + top)
                source[p, k], share[p, k] = found, weight
                total += share[p, k]
        for k in range(4):
            share[p, k] = share[p, k] / max(total, 0.25)


@compiled
def read_properties(
    first, last, source, share, surface, mean, seen_albedo, tilt, seen_gain, point_normal, albedo, normal, gain
):
    """Albedo, normal and lobe gain of points first..last: the captured pixels' as far as they know, else the mean's."""
    for p in range(first, last):
        known, value = ZERO, ZERO
        for k in range(4):
            known += share[p, k]
            value += share[p, k] * seen_gain[max(source[p, k], 0)]
        known = min(max(known, ZERO), ONE)
        gain[p] = value + ONE - known
        length = ZERO
        for axis in range(3):
            color, turn = (ONE - known) * mean[surface[p], axis], point_normal[p, axis]
            for k in range(4):
                if share[p, k] > 0:
                    color += share[p, k] * seen_albedo[source[p, k], axis]
                    turn += share[p, k] * tilt[source[p, k], axis]
            albedo[p, axis], normal[p, axis] = color, turn
            length += turn * turn
        inverse = ONE / max(np.float32(math.sqrt(length)), np.float32(1e-6))
        for axis in range(3):
            normal[p, axis] *= inverse


@compiled
def steps(first, last, right, down, turn, geometric, to_viewer, depth, step):
    """views._steps for points first..last; `turn` (length 0 for none) are the mirrors' reflections on the way."""
    for p in range(first, last):
        facing = ZERO
        for axis in range(3):
            facing -= geometric[p, axis] * to_viewer[p, axis]
        facing = min(facing, np.float32(-0.08))
        for k in range(2):
            slide = ZERO
            for axis in range(3):
                moved = right[axis] if k == 0 else down[axis]
                if len(turn):
                    moved = ZERO
                    for j in range(3):
                        moved += turn[p, axis, j] * (right[j] if k == 0 else down[j])
                step[p, k, axis] = moved * depth[p]
                slide += geometric[p, axis] * step[p, k, axis]
            for axis in range(3):
                step[p, k, axis] += slide / facing * to_viewer[p, axis]


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
    first, last, order, source, share, seen_viewer, to_viewer, is_mirrored, pixel, counts, out_source, out_share
):
    """forward.residual_source away from the captured view, for the points order[first..last]: faded where the spot is
    seen from another side than it was photographed (between 8 and 30 degrees), and a share of the pixel's points.
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
                    alike += seen_viewer[there, axis] * to_viewer[p, axis]
                fade = min(max((alike - far) / (near - far), ZERO), ONE)
                out_share[q, k] = share[p, k] * fade / counts[pixel[p]]


@compiled
def pack_points(
    first, last, order, place, position, geometric, normal, to_viewer, albedo, throughput, gain, step, neighbour, out,
    out_step, out_neighbour,
):  # fmt: skip
    """The points order[first..last] side by side: out[0] to out[5] are position, geometric normal, normal, direction
    to the viewer, albedo / pi * throughput and lobe gain * throughput. `place` says where each point went.
    """
    per_pi = np.float32(1 / math.pi)
    for q in range(first, last):
        p = order[q]
        for axis in range(3):
            out[0, axis, q], out[1, axis, q] = position[p, axis], geometric[p, axis]
            out[2, axis, q], out[3, axis, q] = normal[p, axis], to_viewer[p, axis]
            out[4, axis, q] = albedo[p, axis] * throughput[p, axis] * per_pi
            out[5, axis, q] = gain[p] * throughput[p, axis]
            out_step[q, 0, axis], out_step[q, 1, axis] = step[p, 0, axis], step[p, 1, axis]
        for k in range(4):
            other = neighbour[p, k]
            out_neighbour[q, k] = place[other] if other >= 0 else -1


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
