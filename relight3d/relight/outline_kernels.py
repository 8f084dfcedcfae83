"""The compiled loops between rays and points: the outlines in a picture, and which ray makes which point.

All but `find_edges` walk the picture seat by seat (view_arrays.py), so that neighbours stay together.
"""

import numpy as np

from relight3d.packets import WIDTH
from relight3d.relight.kernels import ONE, ZERO, compiled, inlined
from relight3d.relight.look_kernels import facing_normal, normal_at
from relight3d.relight.view_arrays import BLOCK, NOTHING, SURROUNDINGS


@compiled
def draw(first, last, width, height, with_outlines, mesh, rays, picture):
    """The picture (view_arrays.Picture) of seats first..last; without outlines only what is hit, and labels."""
    blocks_wide = -(-width // BLOCK)
    for begin in range(first, last, WIDTH):
        left, top = begin // WIDTH % blocks_wide * BLOCK, begin // WIDTH // blocks_wide * BLOCK
        for row in range(min(BLOCK, height - top)):
            seat, p = begin + BLOCK * row, (top + row) * width + left
            for k in range(min(BLOCK, width - left)):
                picture.is_hit[p + k], picture.label[p + k] = rays.face[seat + k] != NOTHING, rays.label[seat + k]
            if not with_outlines:
                continue
            for ray in range(seat, seat + min(BLOCK, width - left)):
                f, nx, ny, nz = rays.face[ray], ZERO, ZERO, ZERO
                picture.depth[p] = rays.depth[ray] if f >= 0 else ZERO
                if f >= 0:
                    wx, wy, wz = rays.toward[0, ray], rays.toward[1, ray], rays.toward[2, ray]
                    gx, gy, gz = facing_normal(f, wx, wy, wz, mesh)
                    nx, ny, nz = normal_at(f, rays.u[ray], rays.v[ray], gx, gy, gz, mesh)
                picture.normal[0, p], picture.normal[1, p], picture.normal[2, p] = nx, ny, nz
                p += 1


@inlined
def _breaks(here, there, num, picture, out):
    """out[i] = whether pixels here + i and there + i show different surfaces, depths or directions."""
    label, other = picture.label[here : here + num], picture.label[there : there + num]
    near, far = picture.depth[here : here + num], picture.depth[there : there + num]
    for i in range(num):
        apart = abs(near[i] - far[i]) > np.float32(0.06) * max(near[i], far[i])
        out[i] = (label[i] != other[i]) | apart
    nx, ny, nz = (picture.normal[0, here:], picture.normal[1, here:], picture.normal[2, here:])
    mx, my, mz = (picture.normal[0, there:], picture.normal[1, there:], picture.normal[2, there:])
    for i in range(num):
        alike = nx[i] * mx[i] + ny[i] * my[i] + nz[i] * mz[i]
        out[i] |= (alike < np.float32(0.85)) & (label[i] >= 0)


@inlined
def _join(breaks, edge):
    for i in range(len(edge)):
        edge[i] |= breaks[i]


@compiled
def find_edges(first, last, width, height, picture, breaks):
    """Marks the pixels of rows first..last next to one that shows something else, as views._outlines.

    `breaks`: scratch for a row.
    """
    edge = picture.is_edge
    edge[first * width : last * width] = False
    for y in range(max(first - 1, 0), last):
        begin, end = y * width, (y + 1) * width
        if y + 1 < height:
            _breaks(begin, end, width, picture, breaks)
            if y >= first:
                _join(breaks, edge[begin:end])
            if y + 1 < last:
                _join(breaks, edge[end : end + width])
        if y >= first:
            _breaks(begin, begin + 1, width - 1, picture, breaks)
            _join(breaks, edge[begin : end - 1])
            _join(breaks, edge[begin + 1 : end])


@compiled
def cut_seats(first, last, width, height, is_edge, face, seats):
    """Which of the seats first..last see the mesh and stand on an outline, in `seats`. Returns how many."""
    blocks_wide, count = -(-width // BLOCK), 0
    for begin in range(first, last, WIDTH):
        left, top = begin // WIDTH % blocks_wide * BLOCK, begin // WIDTH // blocks_wide * BLOCK
        for row in range(min(BLOCK, height - top)):
            seat, p = begin + BLOCK * row, (top + row) * width + left
            for k in range(min(BLOCK, width - left)):
                if is_edge[p + k] and face[seat + k] != NOTHING:
                    seats[count] = seat + k
                    count += 1
    return count


@inlined
def _ends(face, begin, num):
    """How many of `num` rays met something, and how many ended in a face."""
    met, found = 0, 0
    for ray in range(begin, begin + num):
        met += face[ray] != NOTHING
        found += face[ray] >= 0
    return met, found


@compiled
def count_points(first, last, face, cut, num_each, begin):
    """How many points, pixels with points, and rays lost to the surroundings seats first..last have; as list_points."""
    num_points, num_ranks, num_lost = 0, 0, 0
    for seat in range(first, last):
        num_points += face[seat] >= 0
        num_lost += face[seat] == SURROUNDINGS
    num_ranks = num_points
    for k in range(len(cut)):
        met, found = _ends(face, begin + k * num_each, num_each)
        if met > 0:
            was_point = face[cut[k]] >= 0
            num_points += found - was_point
            num_ranks += (found > 0) - was_point
            for ray in range(begin + k * num_each, begin + (k + 1) * num_each):
                num_lost += face[ray] == SURROUNDINGS
            num_lost -= face[cut[k]] == SURROUNDINGS
    return num_points, num_ranks, num_lost


@compiled
def list_points(first, last, width, height, face, cut, num_each, ends_in_black, begin, p, rank, lost, listed):
    """The points of seats first..last, written from point `p`, `rank` and `lost` ray on.

    Seats listed in `cut` have `num_each` rays in place of one, from `begin` on, if any of them meets the mesh. Those that
    do share the pixel, or with `ends_in_black` have their part of it.
    """
    blocks_wide, k = -(-width // BLOCK), 0
    for begin_block in range(first, last, WIDTH):
        left, top = begin_block // WIDTH % blocks_wide * BLOCK, begin_block // WIDTH // blocks_wide * BLOCK
        for row in range(min(BLOCK, height - top)):
            for column in range(min(BLOCK, width - left)):
                seat, pixel = begin_block + BLOCK * row + column, (top + row) * width + left + column
                ray, num, met, found = seat, 1, 1, 1
                if k < len(cut) and cut[k] == seat:
                    met, found = _ends(face, begin + k * num_each, num_each)
                    if met > 0:
                        ray, num = begin + k * num_each, num_each
                        met = num_each if ends_in_black else met
                    else:
                        met, found = 1, 1
                    k += 1
                listed.point_of_pixel[pixel] = p if num == 1 and face[ray] >= 0 else -1
                before = p
                for end in range(ray, ray + num):
                    if face[end] >= 0:
                        listed.ray[p] = end
                        listed.part[p], listed.rank_part[p] = ONE / np.float32(met), ONE / np.float32(found)
                        p += 1
                    elif face[end] == SURROUNDINGS:
                        listed.lost[lost], listed.lost_pixel[lost] = end, pixel
                        listed.lost_part[lost] = ONE / np.float32(met)
                        lost += 1
                if p > before:
                    listed.start[rank], listed.pixel_of_rank[rank] = before, pixel
                    rank += 1


@compiled
def find_neighbours(first, last, width, height, p, end, label, point_of_pixel, neighbour):
    """views._neighbours for the points p..end, which are those of seats first..last; none for pixels cut into several."""
    blocks_wide = -(-width // BLOCK)
    for begin in range(first, last, WIDTH):
        left, top = begin // WIDTH % blocks_wide * BLOCK, begin // WIDTH // blocks_wide * BLOCK
        for y in range(top, min(top + BLOCK, height)):
            for x in range(left, min(left + BLOCK, width)):
                pixel = y * width + x
                here, mark = point_of_pixel[pixel], label[pixel]
                if here < 0:
                    continue
                while p < here:  # the points of cut pixels before this one
                    neighbour[p, 0], neighbour[p, 1], neighbour[p, 2], neighbour[p, 3] = -1, -1, -1, -1
                    p += 1
                neighbour[p, 0] = point_of_pixel[pixel + 1] if x + 1 < width and label[pixel + 1] == mark else -1
                neighbour[p, 1] = point_of_pixel[pixel - 1] if x > 0 and label[pixel - 1] == mark else -1
                down, up = pixel + width, pixel - width
                neighbour[p, 2] = point_of_pixel[down] if y + 1 < height and label[down] == mark else -1
                neighbour[p, 3] = point_of_pixel[up] if y > 0 and label[up] == mark else -1
                p += 1
    neighbour[p:end] = -1
