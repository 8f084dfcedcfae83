"""The compiled loops between rays and points: the outlines in a picture, and which ray makes which point.

All but `find_edges` walk the picture seat by seat (view_arrays.py), so that neighbours stay together.
"""

import numpy as np

from relight3d.outlines import CREASE_COSINE, FAR_BEHIND
from relight3d.packets import WIDTH
from relight3d.relight.kernels import ONE, ONE_ON, ZERO, compiled, inlined
from relight3d.relight.view_arrays import BLOCK, NOTHING, SURROUNDINGS

CREASE, FAR = np.float32(CREASE_COSINE), np.float32(FAR_BEHIND)


@inlined
def _draw_row(seat, p, count, with_outlines, rays, picture):
    """Pixels p to p + count, which are seats `seat` and on."""
    for k in range(count):
        picture.is_hit[p + k], picture.label[p + k] = rays.face[seat + k] != NOTHING, rays.label[seat + k]
    if with_outlines:
        for k in range(count):
            picture.depth[p + k] = rays.depth[seat + k] if rays.face[seat + k] >= 0 else ZERO
        for axis in range(3):
            for k in range(count):
                picture.normal[axis, p + k] = rays.normal[axis, seat + k]


@compiled
def draw(first, last, width, height, with_outlines, rays, picture):
    """The picture (view_arrays.Picture) of seats first..last; without outlines only what is hit, and labels."""
    blocks_wide = -(-width // BLOCK)
    for begin in range(first, last, WIDTH):
        left, top = begin // WIDTH % blocks_wide * BLOCK, begin // WIDTH // blocks_wide * BLOCK
        for row in range(min(BLOCK, height - top)):
            seat, p = begin + BLOCK * row, (top + row) * width + left
            if left + BLOCK <= width:
                _draw_row(np.uintp(seat), np.uintp(p), BLOCK, with_outlines, rays, picture)
            else:
                _draw_row(np.uintp(seat), np.uintp(p), width - left, with_outlines, rays, picture)


@inlined
def _breaks(here, there, num, picture, out):
    """out[i] = whether pixels here + i and there + i show different surfaces, depths or directions."""
    label, other = picture.label[here : here + num], picture.label[there : there + num]
    near, far = picture.depth[here : here + num], picture.depth[there : there + num]
    for i in range(num):
        apart = abs(near[i] - far[i]) > FAR * max(near[i], far[i])
        out[i] = (label[i] != other[i]) | apart
    nx, ny, nz = (picture.normal[0, here:], picture.normal[1, here:], picture.normal[2, here:])
    mx, my, mz = (picture.normal[0, there:], picture.normal[1, there:], picture.normal[2, there:])
    for i in range(num):
        alike = nx[i] * mx[i] + ny[i] * my[i] + nz[i] * mz[i]
        out[i] |= (alike < CREASE) & (label[i] >= 0)


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


@compiled
def keep_met(num_each, begin, face, cut, ray_of_cut):
    """Of the seats in `cut` keeps those with a ray that meets the mesh; the others are left as their middle shows them.

    Each has `num_each` rays, from `begin` on; writes where those of the seats that are left begin. Returns how many are.
    """
    count = 0
    for k in range(len(cut)):
        first, is_met = begin + k * num_each, False
        for ray in range(first, first + num_each):
            is_met |= face[ray] != NOTHING
        if is_met:
            cut[count], ray_of_cut[count] = cut[k], first
            count += 1
    return count


@inlined
def _ends(face, begin, num):
    """How many of `num` rays met something, how many ended in a face, and how many in the surroundings."""
    met, found, lost = 0, 0, 0
    for ray in range(begin, begin + num):
        met += face[ray] != NOTHING
        found += face[ray] >= 0
        lost += face[ray] == SURROUNDINGS
    return met, found, lost


@compiled
def count_points(first, last, face, cut, ray_of_cut, num_each):
    """How many points, pixels with points, and rays lost to the surroundings seats first..last have; as list_points."""
    num_points, num_ranks, num_lost = 0, 0, 0
    for seat in range(first, last):
        num_points += face[seat] >= 0
        num_lost += face[seat] == SURROUNDINGS
    num_ranks = num_points
    for k in range(len(cut)):
        _, found, lost = _ends(face, ray_of_cut[k], num_each)
        was_point = face[cut[k]] >= 0
        num_points += found - was_point
        num_ranks += (found > 0) - was_point
        num_lost += lost - (face[cut[k]] == SURROUNDINGS)
    return num_points, num_ranks, num_lost


@compiled
def list_points(
    first, last, width, height, face, cut, ray_of_cut, num_each, ends_in_black, p, rank, lost, listed
):  # fmt: skip
    """The points of seats first..last, written from point `p`, `rank` and `lost` ray on.

    Seats listed in `cut` have `num_each` rays in place of one, from `ray_of_cut` on. Those that meet the mesh share the
    pixel, or with `ends_in_black` have their part of it.
    """
    blocks_wide, k = -(-width // BLOCK), 0
    next_cut = cut[0] if len(cut) else last
    for begin_block in range(first, last, WIDTH):
        left, top = begin_block // WIDTH % blocks_wide * BLOCK, begin_block // WIDTH // blocks_wide * BLOCK
        for row in range(min(BLOCK, height - top)):
            for column in range(min(BLOCK, width - left)):
                seat, pixel = begin_block + BLOCK * row + column, np.uintp((top + row) * width + left + column)
                ray, num, part, rank_part, before = seat, 1, ONE, ONE, p
                if seat == next_cut:
                    ray, num = ray_of_cut[k], num_each
                    met, found, _ = _ends(face, ray, num)
                    part = ONE / np.float32(num_each if ends_in_black else met)
                    rank_part = ONE / np.float32(max(found, 1))
                    k += 1
                    next_cut = cut[k] if k < len(cut) else last
                for end in range(ray, ray + num):
                    if face[np.uintp(end)] >= 0:
                        point = np.uintp(p)
                        listed.ray[point], listed.part[point], listed.rank_part[point] = end, part, rank_part
                        p += 1
                    elif face[end] == SURROUNDINGS:
                        listed.lost[lost], listed.lost_pixel[lost], listed.lost_part[lost] = end, pixel, part
                        lost += 1
                listed.point_of_pixel[pixel] = before if num == 1 and p > before else -1
                if p > before:
                    listed.start[np.uintp(rank)], listed.pixel_of_rank[np.uintp(rank)] = before, pixel
                    rank += 1


@compiled
def find_neighbours(first, last, width, height, p, end, label, point_of_pixel, neighbour):
    """views._neighbours for the points p..end, which are those of seats first..last; none for pixels cut into several."""
    blocks_wide = -(-width // BLOCK)
    for begin in range(first, last, WIDTH):
        left, top = begin // WIDTH % blocks_wide * BLOCK, begin // WIDTH // blocks_wide * BLOCK
        for y in range(top, min(top + BLOCK, height)):
            for x in range(left, min(left + BLOCK, width)):
                pixel = np.uintp(y * width + x)
                here, mark = point_of_pixel[pixel], label[pixel]
                if here < 0:
                    continue
                while p < here:  # the points of cut pixels before this one
                    neighbour[p, 0], neighbour[p, 1], neighbour[p, 2], neighbour[p, 3] = -1, -1, -1, -1
                    p += 1
                right, up, down, point = pixel + ONE_ON, pixel - np.uintp(width), pixel + np.uintp(width), np.uintp(p)
                neighbour[point, 0] = point_of_pixel[right] if x + 1 < width and label[right] == mark else -1
                neighbour[point, 1] = point_of_pixel[pixel - ONE_ON] if x > 0 and label[pixel - ONE_ON] == mark else -1
                neighbour[point, 2] = point_of_pixel[down] if y + 1 < height and label[down] == mark else -1
                neighbour[point, 3] = point_of_pixel[up] if y > 0 and label[up] == mark else -1
                p += 1
    neighbour[p:end] = -1
