"""The compiled loops that make points of rays' ends: where they are, what they are of, and what of it frames read.

They compute what shading.py and views.py compute. A chunk of points goes through all steps while it is in the nearest
cache, and only what frames read is written to memory. Within a chunk points count from 0: arrays are cut to it.
"""

import math

import numpy as np

from relight3d.relight.captured_kernels import (
    ALBEDO,
    FADE,
    GAIN,
    HELD,
    MESH_NORMAL,
    NUM_WORK_ROWS,
    REST,
    TILT,
    fades,
    project,
    read_captured,
)
from relight3d.relight.kernels import ONE, ZERO, compiled, inlined
from relight3d.relight.look_kernels import corners_of, facing_normal, place_at
from relight3d.relight.view_arrays import Scratch

CHUNK = 128
PER_PI = np.float32(1 / math.pi)


def scratch() -> Scratch:
    """What a thread works in."""
    return Scratch(
        work=np.empty((NUM_WORK_ROWS, CHUNK), np.float32),
        image=np.empty((3, CHUNK)),
        known=np.empty((CHUNK, 8), np.float32),
        source=np.empty((CHUNK, 4), np.int32),
        share=np.empty((CHUNK, 4), np.float32),
    )


@inlined
def _place(a, b, listed, rays, mesh, packed, is_read, work):
    """Where the rays of points a..b end, and what they are seen from; marks the vertices about them in `is_read`."""
    position, geometric, to_viewer, corner = packed.position, packed.geometric, packed.to_viewer, packed.corner
    with_corners = len(corner) > 0
    for p in range(a, b):
        ray = np.uintp(listed.ray[p])
        f, u, v = np.uintp(rays.face[ray]), rays.u[ray], rays.v[ray]
        wx, wy, wz = rays.toward[0, ray], rays.toward[1, ray], rays.toward[2, ray]
        packed.surface[p] = rays.label[ray] >> 1
        work[HELD, p - a] = ZERO if rays.label[ray] & 1 else listed.rank_part[p]
        to_viewer[0, p], to_viewer[1, p], to_viewer[2, p] = -wx, -wy, -wz
        gx, gy, gz = facing_normal(f, wx, wy, wz, mesh)
        geometric[0, p], geometric[1, p], geometric[2, p] = gx, gy, gz
        position[0, p], position[1, p], position[2, p] = place_at(f, u, v, mesh)
        for axis in range(3):
            work[MESH_NORMAL + axis, p - a] = rays.normal[axis, ray]
        if with_corners:
            packed.corner_share[p, 0], packed.corner_share[p, 1], packed.corner_share[p, 2] = ONE - u - v, u, v
            i, j, k = corners_of(f, mesh)
            corner[p, 0], corner[p, 1], corner[p, 2] = i, j, k
            is_read[i], is_read[j], is_read[k] = 1, 1, 1


@inlined
def _fill_in(a, b, listed, rays, mesh, captured, packed, scratch):
    """Albedo and lobe gain, in the workspace, and the normal: where no captured pixel knows, the vertices' albedo."""
    vertex, work, known = captured.vertex_albedo, scratch.work, scratch.known
    for i in range(b - a):
        for c in range(7):
            work[ALBEDO + c, i] = known[i, c]
    rest, gain = work[REST, : b - a], work[GAIN, : b - a]
    for i in range(b - a):
        gain[i] += rest[i]
    for i in range(b - a):
        if rest[i] > 0:
            ray = np.uintp(listed.ray[a + i])
            u, v = rays.u[ray], rays.v[ray]
            one, two, three = corners_of(np.uintp(rays.face[ray]), mesh)
            for c in range(3):
                at_point = (ONE - u - v) * vertex[one, c] + u * vertex[two, c] + v * vertex[three, c]
                work[ALBEDO + c, i] += rest[i] * at_point
    mx, my, mz = work[MESH_NORMAL, : b - a], work[MESH_NORMAL + 1, : b - a], work[MESH_NORMAL + 2, : b - a]
    tx, ty, tz = work[TILT, : b - a], work[TILT + 1, : b - a], work[TILT + 2, : b - a]
    for i in range(b - a):
        tx[i], ty[i], tz[i] = mx[i] + tx[i], my[i] + ty[i], mz[i] + tz[i]
    nx, ny, nz = packed.normal[0, a:b], packed.normal[1, a:b], packed.normal[2, a:b]
    for i in range(b - a):
        length = np.float32(math.sqrt(tx[i] * tx[i] + ty[i] * ty[i] + tz[i] * tz[i]))
        inverse = ONE / max(length, np.float32(1e-6))
        nx[i], ny[i], nz[i] = tx[i] * inverse, ty[i] * inverse, tz[i] * inverse


@inlined
def _reflect_through(a, b, listed, rays, packed, work):
    """What each point's light leaves in its pixel: its part of it, and what mirrors on the way take."""
    part, gain = listed.part[a:b], work[GAIN, : b - a]
    for c in range(3):
        albedo, diffuse, gloss = work[ALBEDO + c, : b - a], packed.diffuse[c, a:b], packed.gloss[c, a:b]
        for i in range(b - a):
            diffuse[i], gloss[i] = albedo[i] * part[i] * PER_PI, gain[i] * part[i]
    for p in range(a, b):
        ray = listed.ray[p]
        if rays.label[ray] & 1:
            for c in range(3):
                packed.diffuse[c, p] *= rays.tint[ray, c]
                packed.gloss[c, p] *= rays.tint[ray, c]


@compiled
def fill_points(first, last, listed, rays, mesh, captured, packed, is_read, scratch):
    """Writes what frames read of the points first..last (view_arrays.Packed, but for neighbours).

    `is_read` marks the vertices about some point, where indirect light is wanted.
    """
    with_sources = len(packed.source) > 0
    source, share = (packed.source, packed.source_share) if with_sources else (scratch.source, scratch.share)
    for a in range(first, last, CHUNK):
        b = min(a + CHUNK, last)
        _place(a, b, listed, rays, mesh, packed, is_read, scratch.work)
        project(a, b, captured, packed.position, scratch.image)
        fades(a, b, captured, packed, scratch.work[FADE])
        read_captured(a, b, captured, packed, scratch, source, share, a if with_sources else 0)
        _fill_in(a, b, listed, rays, mesh, captured, packed, scratch)
        _reflect_through(a, b, listed, rays, packed, scratch.work)


@compiled
def tell_points(first, last, listed, rays, mesh, captured, packed, is_read, told, scratch):
    """Writes what frames do not read of the points first..last, and a View has (view_arrays.Told)."""
    for a in range(first, last, CHUNK):
        b = min(a + CHUNK, last)
        ray = listed.ray[a:b]
        _place(a, b, listed, rays, mesh, packed, is_read, scratch.work)
        project(a, b, captured, packed.position, scratch.image)
        scratch.work[FADE, :], scratch.work[HELD, :] = ONE, ONE
        read_captured(a, b, captured, packed, scratch, told.source, told.share, a)
        _fill_in(a, b, listed, rays, mesh, captured, packed, scratch)
        for i in range(b - a):
            for k in range(4):
                if told.share[a + i, k] == 0:
                    told.source[a + i, k] = -1
            p, r = a + i, ray[i]
            told.face[p], told.depth[p], told.is_mirrored[p] = rays.face[r], rays.depth[r], rays.label[r] & 1 > 0
            told.barycentric[p, 0], told.barycentric[p, 1] = ONE - rays.u[r] - rays.v[r], rays.u[r]
            told.barycentric[p, 2], told.lobe_gain[p] = rays.v[r], scratch.work[GAIN, i]
            for c in range(3):
                told.normal[p, c] = scratch.work[MESH_NORMAL + c, i]
                told.albedo[p, c] = scratch.work[ALBEDO + c, i]
                told.throughput[p, c] = listed.part[p] * (rays.tint[r, c] if rays.label[r] & 1 else ONE)


@compiled
def steps(index, ways, ray_of_point, rays, geometric, to_viewer, step):
    """views._steps for the points of `index`; `ways` are the camera's, which mirrors have turned."""
    for i in range(len(index)):
        p, ray, facing = index[i], ray_of_point[index[i]], ZERO
        for axis in range(3):
            facing -= geometric[axis, p] * to_viewer[axis, p]
        facing = min(facing, np.float32(-0.08))
        for k in range(2):
            slide = ZERO
            for axis in range(3):
                way = rays.turned[ray, k, axis] if rays.label[ray] & 1 else ways[k, axis]
                step[i, k, axis] = way * rays.depth[ray]
                slide += geometric[axis, p] * step[i, k, axis]
            for axis in range(3):
                step[i, k, axis] += slide / facing * to_viewer[axis, p]


@compiled
def number_read(is_read, row_of_vertex, vertex):
    """Numbers the vertices that are read, in their order; lists them in `vertex`. Returns how many there are."""
    count = 0
    for v in range(len(is_read)):
        row_of_vertex[v], vertex[count] = count, v
        count += is_read[v]
    return count


@compiled
def renumber(row_of_vertex, corner):
    """Vertices in place become their numbers."""
    for i in range(len(corner)):
        corner[i] = row_of_vertex[corner[i]]
