"""The compiled loops that look from a camera: packets of rays, followed through mirrors, and the outlines in a picture.

A ray ends in a face, or in one of three ways: it met nothing, a mirror sent it to the surroundings, or it was still
among mirrors when no more were to be followed. They compute what views.build_view computes.
"""

import math

import numba
import numpy as np

from relight3d.packets import (
    DIRECTION,
    FAR,
    HIT_PRIMITIVE,
    HIT_U,
    HIT_V,
    NEVER,
    NUM_HIT_ROWS,
    NUM_RAY_ROWS,
    ORIGIN,
    WIDTH,
    call_query,
    empty_packet,
)
from relight3d.relight.kernels import ONE, ZERO, compiled, inlined

NOTHING, SURROUNDINGS, AMONG_MIRRORS = -1, -2, -3  # in place of a face
TWO = np.float32(2)


@compiled
def pixel_rays(first, last, pixel, shift_x, shift_y, corner, right, down, width, directions):
    """Unit directions through places in pixels first..last of a camera without distortion; one for each shift."""
    for i in range(first, last):
        for k in range(len(shift_x)):
            x, y = pixel[i] % width + shift_x[k], pixel[i] // width + shift_y[k]
            dx = corner[0] + x * right[0] + y * down[0]
            dy = corner[1] + x * right[1] + y * down[1]
            dz = corner[2] + x * right[2] + y * down[2]
            inverse = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
            ray = i * len(shift_x) + k
            directions[ray, 0], directions[ray, 1], directions[ray, 2] = dx * inverse, dy * inverse, dz * inverse


@inlined
def surface_point(f, u, v, wx, wy, wz, faces, vertices, vertex_normals, face_normals):
    """Position, geometric and shading normal, both towards the viewer, of a point seen in direction w."""
    a = ONE - u - v
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    px = a * vertices[i, 0] + u * vertices[j, 0] + v * vertices[k, 0]
    py = a * vertices[i, 1] + u * vertices[j, 1] + v * vertices[k, 1]
    pz = a * vertices[i, 2] + u * vertices[j, 2] + v * vertices[k, 2]
    nx = a * vertex_normals[i, 0] + u * vertex_normals[j, 0] + v * vertex_normals[k, 0]
    ny = a * vertex_normals[i, 1] + u * vertex_normals[j, 1] + v * vertex_normals[k, 1]
    nz = a * vertex_normals[i, 2] + u * vertex_normals[j, 2] + v * vertex_normals[k, 2]
    gx, gy, gz = face_normals[f, 0], face_normals[f, 1], face_normals[f, 2]
    if gx * wx + gy * wy + gz * wz > 0:
        gx, gy, gz = -gx, -gy, -gz
    length = nx * nx + ny * ny + nz * nz
    if length > 1e-12:
        inverse = ONE / np.float32(math.sqrt(length))
        nx, ny, nz = nx * inverse, ny * inverse, nz * inverse
    else:
        nx, ny, nz = gx, gy, gz
    if nx * gx + ny * gy + nz * gz < 0:
        nx, ny, nz = -nx, -ny, -nz
    return px, py, pz, gx, gy, gz, nx, ny, nz


@inlined
def _reflect(normal, vector):
    """The vector mirrored in the plane of a unit normal."""
    along = TWO * (normal[0] * vector[0] + normal[1] * vector[1] + normal[2] * vector[2])
    for axis in range(3):
        vector[axis] -= along * normal[axis]


@inlined
def _bounce(ray, lane, offset, mesh, u, v, face, toward, turned, normal, rays):
    """Turns a ray that ended in a mirror; False where that leads below the mirror's own surface."""
    px, py, pz, gx, gy, gz, nx, ny, nz = surface_point(
        face[ray], u[ray], v[ray], toward[ray, 0], toward[ray, 1], toward[ray, 2], *mesh
    )
    normal[0], normal[1], normal[2] = nx, ny, nz
    _reflect(normal, toward[ray])
    _reflect(normal, turned[ray, 0])
    _reflect(normal, turned[ray, 1])
    rays[ORIGIN, lane], rays[ORIGIN + 1, lane] = px + gx * offset, py + gy * offset
    rays[ORIGIN + 2, lane] = pz + gz * offset
    for axis in range(3):
        rays[DIRECTION + axis, lane] = toward[ray, axis]
    return toward[ray, 0] * gx + toward[ray, 1] * gy + toward[ray, 2] * gz > 0


@numba.njit(nogil=True, cache=True, error_model="numpy")
def look(
    first, last, query, scene, arguments, offset, eye, ways, max_bounces, reflectance, surface_of_face, mesh,
    face, u, v, depth, toward, bounces, tint, turned,
):  # fmt: skip
    """Traces rays first..last from `eye`, and on from mirrors (surfaces whose `reflectance`, surface x 3, is not 0).

    `ways` are the camera's steps to the right and down for one pixel at depth 1. Written for each ray: where it ends
    (`face`, `u`, `v`), the way it took (`depth`), its last direction (`toward`, at first the camera's), how many mirrors
    it met (`bounces`), what they leave of light (`tint`) and, if any, how they turn `ways` (`turned`). `mesh`: faces,
    vertices, vertex and face normals. Returns how many rays were reflected.
    """
    words, rays, active = empty_packet(NUM_HIT_ROWS)
    normal, num_reflected = np.empty(3, np.float32), 0
    for start in range(first, last, WIDTH):
        count = min(WIDTH, last - start)
        for lane in range(WIDTH):
            ray = start + min(lane, count - 1)
            for axis in range(3):
                rays[ORIGIN + axis, lane], rays[DIRECTION + axis, lane] = eye[axis], toward[ray, axis]
                tint[ray, axis] = ONE
            active[lane] = -1 if lane < count else 0
            face[ray], depth[ray], bounces[ray] = NOTHING, ZERO, 0
        for bounce in range(max_bounces + 1):
            rays[FAR], words[NUM_RAY_ROWS:] = NEVER, -1
            call_query(query, active.ctypes.data, scene, words.ctypes.data, arguments)  # pyright: ignore[reportCallIssue]
            waiting = 0
            for lane in range(count):
                if active[lane] == 0:
                    continue
                ray, hit = start + lane, words[HIT_PRIMITIVE, lane]
                active[lane] = 0
                if hit < 0:
                    face[ray] = NOTHING if bounce == 0 else SURROUNDINGS
                    continue
                face[ray], u[ray], v[ray] = hit, rays[HIT_U, lane], rays[HIT_V, lane]
                depth[ray] += rays[FAR, lane]
                surface = surface_of_face[hit]
                if reflectance[surface, 0] + reflectance[surface, 1] + reflectance[surface, 2] == 0:
                    continue
                if bounce == max_bounces:
                    face[ray] = AMONG_MIRRORS
                    continue
                num_reflected += 1
                bounces[ray] += 1
                if bounce == 0:
                    for k in range(2):
                        for axis in range(3):
                            turned[ray, k, axis] = ways[k, axis]
                for axis in range(3):
                    tint[ray, axis] *= reflectance[surface, axis]
                if _bounce(ray, lane, offset, mesh, u, v, face, toward, turned, normal, rays):
                    active[lane] = -1
                    waiting += 1
                else:
                    face[ray] = SURROUNDINGS
            if waiting == 0:
                break
    return num_reflected


@compiled
def label_pixels(first, last, pixel, surface_of_face, mesh, face, u, v, depth, toward, bounces, label, far, normal):
    """What the outlines go by, in the picture's order: surface and whether it is mirrored (or below 0), depth, normal."""
    for seat in range(first, last):
        p, f = pixel[seat], face[seat]
        if f < 0:
            label[p], far[p] = -2 if f == SURROUNDINGS else -1, ZERO
            normal[0, p], normal[1, p], normal[2, p] = ZERO, ZERO, ZERO
            continue
        label[p], far[p] = 2 * surface_of_face[f] + (bounces[seat] > 0), depth[seat]
        _, _, _, _, _, _, normal[0, p], normal[1, p], normal[2, p] = surface_point(
            f, u[seat], v[seat], toward[seat, 0], toward[seat, 1], toward[seat, 2], *mesh
        )


@compiled
def find_breaks(first, last, stride, label, far, normal, breaks):
    """breaks[p] = whether pixel p and pixel p + stride show different surfaces, depths or directions."""
    n = last - first
    out, mark, other = breaks[first:last], label[first:last], label[first + stride : last + stride]
    here, there = far[first:last], far[first + stride : last + stride]
    for i in range(n):
        apart = abs(here[i] - there[i]) > np.float32(0.06) * max(here[i], there[i])
        out[i] = (mark[i] != other[i]) | apart
    for i in range(n):
        p, q = first + i, first + stride + i
        alike = normal[0, p] * normal[0, q] + normal[1, p] * normal[1, q] + normal[2, p] * normal[2, q]
        out[i] |= (alike < np.float32(0.85)) & (mark[i] >= 0)


@compiled
def cut_seats(pixel, width, height, beside, below, face, seats):
    """Which seats (pixels that see the mesh) stand on an outline: written from seats[0] on. Returns how many.

    `beside` and `below` are the breaks to the right and down.
    """
    count = 0
    for seat in range(len(pixel)):
        p = pixel[seat]
        column, row = p % width, p // width
        edge = (column + 1 < width and beside[p]) or (column > 0 and beside[p - 1])
        edge = edge or (row + 1 < height and below[p]) or (row > 0 and below[p - width])
        if edge and face[seat] != NOTHING:
            seats[count] = seat
            count += 1
    return count


@compiled
def list_points(pixel, face, cut, num_each, ray_of_point, part, pixel_of_point, is_cut, lost, lost_part, lost_pixel):
    """The points of the view, seat by seat: which ray ends there, and its part of the pixel.

    Seats listed in `cut` have `num_each` rays in place of one, after those of the seats, if any of them meets the mesh.
    `lost` gets the rays that ended in the surroundings. Returns how many points and lost rays there are.
    """
    num_points, num_lost, next_cut = 0, 0, 0
    for seat in range(len(pixel)):
        first, last, hits = seat, seat + 1, 1
        if next_cut < len(cut) and cut[next_cut] == seat:
            begin, met = len(pixel) + next_cut * num_each, 0
            for ray in range(begin, begin + num_each):
                met += face[ray] != NOTHING
            if met > 0:
                first, last, hits, is_cut[pixel[seat]] = begin, begin + num_each, met, True
            next_cut += 1
        for ray in range(first, last):
            if face[ray] == SURROUNDINGS:
                lost[num_lost], lost_part[num_lost] = ray, ONE / np.float32(hits)
                lost_pixel[num_lost] = pixel[seat]
                num_lost += 1
            elif face[ray] >= 0:
                ray_of_point[num_points], part[num_points] = ray, ONE / np.float32(hits)
                pixel_of_point[num_points] = pixel[seat]
                num_points += 1
    return num_points, num_lost
