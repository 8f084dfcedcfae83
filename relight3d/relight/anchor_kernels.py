"""The compiled loops that find anchors: which point of another pixel lies on the same smooth piece of a surface."""

from relight3d.relight.kernels import compiled, inlined


@inlined
def _alike(p, q, label, depth, normal, step_in_depth, crease_cosine):
    """Whether two points are of one surface, near each other in depth, and face alike."""
    if label[p] != label[q] or not abs(depth[q] - depth[p]) < step_in_depth * depth[p]:
        return False
    cosine = normal[0, p] * normal[0, q] + normal[1, p] * normal[1, q] + normal[2, p] * normal[2, q]
    return cosine > crease_cosine


@compiled
def look_up(grid, width, height, x, y, at, label, depth, normal, step_in_depth, crease_cosine, found):
    """The points of pixels x, y in a grid where they are alike to the points `at`; else -1."""
    for i in range(len(at)):
        found[i] = -1
        if x[i] < 0 or x[i] >= width or y[i] < 0 or y[i] >= height:
            continue
        other = grid[y[i] * width + x[i]]
        if other >= 0 and _alike(at[i], other, label, depth, normal, step_in_depth, crease_cosine):
            found[i] = other


@compiled
def find_leads(start, label, normal, crease_cosine, lead):
    """The first point of the same pixel and surface that faces alike, or the point itself."""
    for r in range(len(start) - 1):
        for p in range(start[r], start[r + 1]):
            lead[p] = p
            for q in range(start[r], p):
                if label[p] == label[q]:
                    cosine = normal[0, p] * normal[0, q] + normal[1, p] * normal[1, q] + normal[2, p] * normal[2, q]
                    lead[p] = q if cosine > crease_cosine else p
                    break
