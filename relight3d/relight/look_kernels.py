"""The compiled loops that look from a camera: packets of rays, followed through mirrors.

A ray ends in a face, or in one of three ways: it met nothing, a mirror sent it to the surroundings, or it was still
among mirrors when no more were to be followed. They compute what views.build_view computes.
"""

import math

import numpy as np

from relight3d.packets import (
    DIRECTION,
    FAR,
    HIT_GEOMETRY,
    HIT_PRIMITIVE,
    HIT_U,
    HIT_V,
    NEVER,
    NUM_RAY_ROWS,
    ORIGIN,
    WIDTH,
    call_query,
)
from relight3d.relight.kernels import ONE, ZERO, compiled, inlined
from relight3d.relight.view_arrays import AMONG_MIRRORS, ASKED, BLOCK, NOTHING, SURROUNDINGS

TWO = np.float32(2)


@compiled
def seat_rays(first, last, width, height, corner, right, down, shift_x, shift_y, is_given, rays):
    """Unit directions through the seats first..last of a camera without distortion; those in no pixel are not asked for.

    Seats begin a block. With `is_given` the directions stay as they are.
    """
    blocks_wide = -(-width // BLOCK)
    for begin in range(first, last, WIDTH):
        block = begin // WIDTH
        left, top = block % blocks_wide * BLOCK, block // blocks_wide * BLOCK
        face = rays.face[begin : begin + WIDTH]
        for lane in range(WIDTH):
            inside = (left + lane % BLOCK < width) & (top + lane // BLOCK < height)
            face[lane] = ASKED if inside else NOTHING
        if is_given:
            continue
        dx, dy = rays.toward[0, begin : begin + WIDTH], rays.toward[1, begin : begin + WIDTH]
        dz = rays.toward[2, begin : begin + WIDTH]
        for lane in range(WIDTH):
            x, y = left + lane % BLOCK + shift_x, top + lane // BLOCK + shift_y
            ex = corner[0] + x * right[0] + y * down[0]
            ey = corner[1] + x * right[1] + y * down[1]
            ez = corner[2] + x * right[2] + y * down[2]
            inverse = 1.0 / math.sqrt(ex * ex + ey * ey + ez * ez)
            dx[lane], dy[lane], dz[lane] = ex * inverse, ey * inverse, ez * inverse


@compiled
def cut_rays(seats, width, corner, right, down, shift_x, shift_y, is_given, begin, rays):
    """As seat_rays, through several places of each pixel; the rays stand from `begin` on, pixel by pixel."""
    blocks_wide, ray = -(-width // BLOCK), begin
    for seat in seats:
        block, lane = seat // WIDTH, seat % WIDTH
        left, top = block % blocks_wide * BLOCK + lane % BLOCK, block // blocks_wide * BLOCK + lane // BLOCK
        for k in range(len(shift_x)):
            rays.face[ray] = ASKED
            if not is_given:
                x, y = left + shift_x[k], top + shift_y[k]
                dx = corner[0] + x * right[0] + y * down[0]
                dy = corner[1] + x * right[1] + y * down[1]
                dz = corner[2] + x * right[2] + y * down[2]
                inverse = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
                rays.toward[0, ray], rays.toward[1, ray], rays.toward[2, ray] = dx * inverse, dy * inverse, dz * inverse
            ray += 1


@inlined
def corners_of(f, mesh):
    """The vertices of a face. Unsigned: an index that could be negative is asked about at every access."""
    f = np.uintp(f)
    return np.uintp(mesh.faces[f, 0]), np.uintp(mesh.faces[f, 1]), np.uintp(mesh.faces[f, 2])


@inlined
def normal_at(f, u, v, gx, gy, gz, mesh):
    """The shading normal of a point on face f, on the side of the geometric normal g (which already faces the viewer)."""
    a, (i, j, k), n = ONE - u - v, corners_of(f, mesh), mesh.vertex_normals
    nx = a * n[i, 0] + u * n[j, 0] + v * n[k, 0]
    ny = a * n[i, 1] + u * n[j, 1] + v * n[k, 1]
    nz = a * n[i, 2] + u * n[j, 2] + v * n[k, 2]
    length = nx * nx + ny * ny + nz * nz
    if length > 1e-12:
        inverse = ONE / np.float32(math.sqrt(length))
        nx, ny, nz = nx * inverse, ny * inverse, nz * inverse
    else:
        nx, ny, nz = gx, gy, gz
    if nx * gx + ny * gy + nz * gz < 0:
        nx, ny, nz = -nx, -ny, -nz
    return nx, ny, nz


@inlined
def facing_normal(f, wx, wy, wz, mesh):
    """The geometric normal of face f, towards the viewer who looks in direction w."""
    f = np.uintp(f)
    gx, gy, gz = mesh.face_normals[f, 0], mesh.face_normals[f, 1], mesh.face_normals[f, 2]
    if gx * wx + gy * wy + gz * wz > 0:
        return -gx, -gy, -gz
    return gx, gy, gz


@inlined
def place_at(f, u, v, mesh):
    """Position of a point on face f."""
    a, (i, j, k), c = ONE - u - v, corners_of(f, mesh), mesh.vertices
    px = a * c[i, 0] + u * c[j, 0] + v * c[k, 0]
    py = a * c[i, 1] + u * c[j, 1] + v * c[k, 1]
    pz = a * c[i, 2] + u * c[j, 2] + v * c[k, 2]
    return px, py, pz


@inlined
def _reflect(normal, vector):
    """The vector mirrored in the plane of a unit normal."""
    along = TWO * (normal[0] * vector[0] + normal[1] * vector[1] + normal[2] * vector[2])
    for axis in range(3):
        vector[axis] -= along * normal[axis]


@inlined
def _bounce(ray, lane, offset, mesh, rays, packet):
    """Turns a ray that ended in a mirror; False where that leads below the mirror's own surface."""
    f, u, v, toward = rays.face[ray], rays.u[ray], rays.v[ray], rays.toward[:, ray]
    gx, gy, gz = facing_normal(f, toward[0], toward[1], toward[2], mesh)
    normal = normal_at(f, u, v, gx, gy, gz, mesh)
    _reflect(normal, toward)
    _reflect(normal, rays.turned[ray, 0])
    _reflect(normal, rays.turned[ray, 1])
    px, py, pz = place_at(f, u, v, mesh)
    packet[ORIGIN, lane], packet[ORIGIN + 1, lane] = px + gx * offset, py + gy * offset
    packet[ORIGIN + 2, lane] = pz + gz * offset
    for axis in range(3):
        packet[DIRECTION + axis, lane] = toward[axis]
    return toward[0] * gx + toward[1] * gy + toward[2] * gz > 0


@inlined
def _first_leg(start, count, eye, rays, active, packet):
    """Fills a packet with the rays from `start` on; lanes beyond `count` repeat the last one, switched off."""
    for axis in range(3):
        direction, given = packet[DIRECTION + axis], rays.toward[axis, start : start + count]
        packet[ORIGIN + axis, :] = eye[axis]
        for lane in range(count):
            direction[lane] = given[lane]
        direction[count:] = given[count - 1]
    active[count:] = 0
    for lane in range(count):
        active[lane] = -1 if rays.face[start + lane] == ASKED else 0


@inlined
def _settle(start, count, active, words, packet, is_mirror, surface_of_face, rays):
    """Writes down where a packet's first legs end. Returns in how many mirrors; the lanes of no others stay switched on."""
    face, label, found = rays.face[start : start + count], rays.label[start : start + count], words[HIT_PRIMITIVE]
    u, v, depth = rays.u[start : start + count], rays.v[start : start + count], rays.depth[start : start + count]
    for lane in range(count):
        face[lane] = found[lane] if active[lane] else NOTHING
    for lane in range(count):
        u[lane], v[lane], depth[lane] = packet[HIT_U, lane], packet[HIT_V, lane], packet[FAR, lane]
    num_mirrors = 0
    for lane in range(count):
        label[lane], active[lane] = NOTHING, 0
        if face[lane] >= 0:
            surface = surface_of_face[np.uintp(face[lane])]
            label[lane], active[lane] = 2 * surface, -is_mirror[np.uintp(surface)]
            num_mirrors += is_mirror[np.uintp(surface)]
    return num_mirrors


@inlined
def _follow(ray, lane, is_last, offset, ways, is_mirror, reflectance, mesh, rays, packet):
    """Sends a ray that ended in a mirror on, or writes down why not. Whether it goes on, and whether it was reflected."""
    surface = np.uintp(rays.label[ray] >> 1)
    if is_mirror[surface] == 0:
        return False, False
    if is_last:
        rays.face[ray], rays.label[ray] = AMONG_MIRRORS, NOTHING
        return False, False
    if rays.label[ray] & 1 == 0:
        for axis in range(3):
            rays.tint[ray, axis] = ONE
            rays.turned[ray, 0, axis], rays.turned[ray, 1, axis] = ways[0, axis], ways[1, axis]
    for axis in range(3):
        rays.tint[ray, axis] *= reflectance[surface, axis]
    if _bounce(ray, lane, offset, mesh, rays, packet):
        return True, True
    rays.face[ray], rays.label[ray] = SURROUNDINGS, SURROUNDINGS
    return False, True


@compiled
def look(
    first, last, query, scene, arguments, offset, eye, ways, max_bounces, is_mirror, reflectance, mesh, room, rays
):  # fmt: skip
    """Traces those of the rays first..last that are asked for, from `eye`, and on from mirrors.

    `is_mirror` and `reflectance` (x 3) go by surface; `ways` are the camera's steps to the right and down for one pixel at
    depth 1; `room` is an empty packet. Returns how many rays were reflected.
    """
    words, packet, active = room
    words[NUM_RAY_ROWS:] = -1
    num_reflected = 0
    for start in range(first, last, WIDTH):
        count = min(WIDTH, last - start)
        _first_leg(start, count, eye, rays, active, packet)
        for bounce in range(max_bounces + 1):
            packet[FAR, :] = NEVER
            words[HIT_PRIMITIVE, :], words[HIT_GEOMETRY, :] = -1, -1
            call_query(query, active.ctypes.data, scene, words.ctypes.data, arguments)  # pyright: ignore[reportCallIssue]
            if bounce == 0:
                mirrors = (is_mirror, mesh.surface_of_face)
                if _settle(start, count, active, words, packet, *mirrors, rays) == 0:
                    break
            waiting = 0
            for i in range(count):
                lane, ray = np.uintp(i), np.uintp(start + i)
                if active[lane] == 0:
                    continue
                active[lane] = 0
                if bounce > 0:
                    hit = words[HIT_PRIMITIVE, lane]
                    if hit < 0:
                        rays.face[ray], rays.label[ray] = SURROUNDINGS, SURROUNDINGS
                        continue
                    rays.face[ray], rays.u[ray], rays.v[ray] = hit, packet[HIT_U, lane], packet[HIT_V, lane]
                    rays.depth[ray] += packet[FAR, lane]
                    rays.label[ray] = 2 * mesh.surface_of_face[np.uintp(hit)] + 1
                is_last = bounce == max_bounces
                goes_on, is_reflected = _follow(
                    ray, lane, is_last, offset, ways, is_mirror, reflectance, mesh, rays, packet
                )  # fmt: skip
                num_reflected += is_reflected
                if goes_on:
                    active[lane] = -1
                    waiting += 1
            if waiting == 0:
                break
    return num_reflected


@compiled
def write_normals(first, last, mesh, rays):
    """The shading normals where the rays first..last ended."""
    for k in range(first, last):
        ray = np.uintp(k)
        f, nx, ny, nz = rays.face[ray], ZERO, ZERO, ZERO
        if f >= 0:
            wx, wy, wz = rays.toward[0, ray], rays.toward[1, ray], rays.toward[2, ray]
            gx, gy, gz = facing_normal(f, wx, wy, wz, mesh)
            nx, ny, nz = normal_at(f, rays.u[ray], rays.v[ray], gx, gy, gz, mesh)
        rays.normal[0, ray], rays.normal[1, ray], rays.normal[2, ray] = nx, ny, nz
