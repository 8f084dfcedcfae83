"""The compiled loops that pack any view's points for frames (buffers.py, modes.py)."""

import math

import numpy as np

from relight3d.relight.kernels import ONE, ZERO, compiled


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


@compiled
def take_sites(first, last, rows, places, coefficients, ambient, out_places, out_coefficients, out_ambient):
    """Where some sites are, their coefficients and ambient light: of rows[first..last]."""
    num = coefficients.shape[1]
    for i in range(first, last):
        row = rows[i]
        for c in range(3):
            out_places[i, c], out_ambient[i, c] = places[row, c], ambient[row, c]
        for k in range(num):
            for c in range(3):
                out_coefficients[i, k, c] = coefficients[row, k, c]


@compiled
def blend_modes(first, last, begin, start, member, source, share, modes, out):
    """The modes of items begin + first to begin + last: of their points, members start[item] to start[item + 1], by the
    captured points that these read.
    """
    for i in range(first, last):
        for m in range(modes.shape[1]):
            for c in range(3):
                out[i, m, c] = ZERO
        for k in range(start[begin + i], start[begin + i + 1]):
            p = member[k]
            for s in range(source.shape[1]):
                part, row = share[p, s], source[p, s]
                if part != 0:
                    for m in range(modes.shape[1]):
                        for c in range(3):
                            out[i, m, c] += part * modes[row, m, c]
