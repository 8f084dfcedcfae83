"""The compiled loops between rays and points: the outlines in a picture, and which ray makes which point.

All but `find_sides` walk the picture seat by seat (view_arrays.py), so that neighbours stay together.
"""

import numpy as np

from relight3d.outlines import ABOVE, BELOW, LEFT, RIGHT
from relight3d.packets import WIDTH
from relight3d.relight.kernels import ONE, ZERO, compiled, inlined
from relight3d.relight.view_arrays import BLOCK, NOTHING, SURROUNDINGS

ONE_ON = np.uintp(1)  # unsigned: an index that could be negative is asked about at every access
TO_RIGHT, TO_LEFT, TO_BELOW, TO_ABOVE = np.uint8(RIGHT), np.uint8(LEFT), np.uint8(BELOW), np.uint8(ABOVE)
FAR_BEHIND, ALIKE = np.float32(0.06), np.float32(0.85)  # as outlines.is_break


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
        apart = abs(near[i] - far[i]) > FAR_BEHIND * max(near[i], far[i])
        out[i] = (label[i] != other[i]) | apart
    nx, ny, nz = (picture.normal[0, here:], picture.normal[1, here:], picture.normal[2, here:])
    mx, my, mz = (picture.normal[0, there:], picture.normal[1, there:], picture.normal[2, there:])
    for i in range(num):
        alike = nx[i] * mx[i] + ny[i] * my[i] + nz[i] * mz[i]
        out[i] |= (alike < ALIKE) & (label[i] >= 0)


@inlined
def _join(breaks, side, sides):
    for i in range(len(sides)):
        sides[i] |= side if breaks[i] else np.uint8(0)


@compiled
def find_sides(first, last, width, height, picture, breaks):
    """On which sides the pixels of rows first..last end in something else, as views._outlines.

    `breaks`: scratch for a row.
    """
    sides = picture.sides
    sides[first * width : last * width] = 0
    for y in range(max(first - 1, 0), last):
        begin, end = y * width, (y + 1) * width
        if y + 1 < height:
            _breaks(begin, end, width, picture, breaks)
            if y >= first:
                _join(breaks, TO_BELOW, sides[begin:end])
            if y + 1 < last:
                _join(breaks, TO_ABOVE, sides[end : end + width])
        if y >= first:
            _breaks(begin, begin + 1, width - 1, picture, breaks)
            _join(breaks, TO_RIGHT, sides[begin : end - 1])
            _join(breaks, TO_LEFT, sides[begin + 1 : end])


@compiled
def cut_seats(first, last, width, height, sides, face, num_of_sides, begin_ray, cuts):
    """Lists those of the seats first..last that see the mesh and stand on an outline. Returns how many, and their rays' end.

    Each has as many rays as its sides call for, from `begin_ray` on.
    """
    blocks_wide, count, ray = -(-width // BLOCK), 0, begin_ray
    for begin in range(first, last, WIDTH):
        left, top = begin // WIDTH % blocks_wide * BLOCK, begin // WIDTH // blocks_wide * BLOCK
        for row in range(min(BLOCK, height - top)):
            seat, p = begin + BLOCK * row, (top + row) * width + left
            for k in range(min(BLOCK, width - left)):
                if sides[p + k] > 0 and face[seat + k] != NOTHING:
                    cuts.seat[count], cuts.ray[count] = seat + k, ray
                    cuts.num[count] = num_of_sides[sides[p + k]]
                    ray += cuts.num[count]
                    count += 1
    return count, ray


@inlined
def _differs(ray, seat, rays):
    """Whether a ray shows something else than the one through its pixel's middle."""
    if rays.face[ray] < 0 or rays.label[ray] != rays.label[seat]:
        return True
    depth, middle, alike = rays.depth[ray], rays.depth[seat], ZERO
    for axis in range(3):
        alike += rays.normal[axis, ray] * rays.normal[axis, seat]
    return (abs(depth - middle) > FAR_BEHIND * max(depth, middle)) | (alike < ALIKE)


@compiled
def keep_several(num_each, rays, cuts):
    """Of the cuts keeps those with a ray that shows something else than the pixel's middle, as views._shows_several.

    Returns how many are left.
    """
    count = 0
    for k in range(len(cuts.seat)):
        seat, first, num = cuts.seat[k], cuts.ray[k], cuts.num[k]
        is_several, is_met = False, num < num_each
        for ray in range(first, first + num):
            is_met |= rays.face[ray] != NOTHING
            is_several |= _differs(ray, seat, rays)
        if is_several and is_met:
            cuts.seat[count], cuts.ray[count], cuts.num[count] = seat, first, num
            count += 1
    return count


@inlined
def _ends(k, num_each, face, cuts):
    """Of the samples of a cut, how many met something; of its points and lost rays, how many there are."""
    begin, num = cuts.ray[k], cuts.num[k]
    met, found, lost = num_each - num, 0, 0
    for ray in range(begin, begin + num):
        met += face[ray] != NOTHING
        found += face[ray] >= 0
        lost += face[ray] == SURROUNDINGS
    if num < num_each:
        found += face[cuts.seat[k]] >= 0
        lost += face[cuts.seat[k]] == SURROUNDINGS
    return met, found, lost


@compiled
def count_points(first, last, num_each, face, cuts):
    """How many points, pixels with points, and rays lost to the surroundings seats first..last have; as list_points."""
    num_points, num_ranks, num_lost = 0, 0, 0
    for seat in range(first, last):
        num_points += face[seat] >= 0
        num_lost += face[seat] == SURROUNDINGS
    num_ranks = num_points
    for k in range(len(cuts.seat)):
        _, found, lost = _ends(k, num_each, face, cuts)
        was_point = face[cuts.seat[k]] >= 0
        num_points += found - was_point
        num_ranks += (found > 0) - was_point
        num_lost += lost - (face[cuts.seat[k]] == SURROUNDINGS)
    return num_points, num_ranks, num_lost


@inlined
def _list(end, pixel, part, rank_part, face, p, lost, listed):
    """Writes down where a ray ended. Returns the next point's and lost ray's place."""
    if face[np.uintp(end)] >= 0:
        point = np.uintp(p)
        listed.ray[point], listed.part[point], listed.rank_part[point] = end, part, rank_part
        return p + 1, lost
    if face[end] == SURROUNDINGS:
        listed.lost[lost], listed.lost_pixel[lost], listed.lost_part[lost] = end, pixel, part
        return p, lost + 1
    return p, lost


@compiled
def list_points(first, last, width, height, num_each, ends_in_black, face, cuts, p, rank, lost, listed):
    """The points of seats first..last, written from point `p`, `rank` and `lost` ray on.

    Those that meet the mesh of a cut pixel's samples share it, or with `ends_in_black` have their part of it.
    """
    blocks_wide, k = -(-width // BLOCK), 0
    next_cut = cuts.seat[0] if len(cuts.seat) else last
    for begin_block in range(first, last, WIDTH):
        left, top = begin_block // WIDTH % blocks_wide * BLOCK, begin_block // WIDTH // blocks_wide * BLOCK
        for row in range(min(BLOCK, height - top)):
            for column in range(min(BLOCK, width - left)):
                seat, pixel = begin_block + BLOCK * row + column, np.uintp((top + row) * width + left + column)
                before, is_whole = p, seat != next_cut
                if is_whole:
                    p, lost = _list(seat, pixel, ONE, ONE, face, p, lost, listed)
                else:
                    met, found, _ = _ends(k, num_each, face, cuts)
                    part = ONE / np.float32(num_each if ends_in_black else met)
                    rank_part = ONE / np.float32(max(found, 1))
                    for ray in range(cuts.ray[k], cuts.ray[k] + cuts.num[k]):
                        p, lost = _list(ray, pixel, part, rank_part, face, p, lost, listed)
                    if cuts.num[k] < num_each:
                        part *= np.float32(num_each - cuts.num[k])
                        p, lost = _list(seat, pixel, part, rank_part, face, p, lost, listed)
                    k += 1
                    next_cut = cuts.seat[k] if k < len(cuts.seat) else last
                listed.point_of_pixel[pixel] = before if is_whole and p > before else -1
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
