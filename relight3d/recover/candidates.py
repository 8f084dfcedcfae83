"""Which surfaces a scene has, and which of them may be mirrors."""

from dataclasses import replace
from typing import TYPE_CHECKING

from relight3d.effects import forced_states
from relight3d.records import Capture, Mirror, PatchMesh, ShadingPoints, Surfaces
from relight3d.recover import diffuse, mirror, surfaces, visibility
from relight3d.recover.training import Training
from relight3d.tracing import RayScene

if TYPE_CHECKING:
    from relight3d.recover.run import RecoverOptions


def find_surfaces(
    capture: Capture,
    mesh: PatchMesh,
    rays: RayScene,
    points: ShadingPoints,
    photographs: Training,
    options: "RecoverOptions",
) -> Surfaces:
    """The mesh's own labels when it has them, else regions of one material from a first, rough albedo."""
    found = surfaces.surfaces_from_labels(mesh) if options.use_labels else None
    if found is not None:
        return found
    rough = visibility.observe(
        rays, mesh, points, capture.camera, photographs.radiance, photographs.is_valid, photographs.lights,
        options.visibility,
    )  # fmt: skip
    weight = rough.weight * rough.is_safe * ~rough.is_highlight
    guess, information = diffuse.pixel_albedo(rough, rough.radiance, weight, rough.form, None)
    return surfaces.surfaces_from_photographs(
        mesh, points, capture.camera, guess, information.mean(axis=1), options.surfaces
    )


def test_mirrors(
    capture: Capture,
    mesh: PatchMesh,
    rays: RayScene,
    points: ShadingPoints,
    found: Surfaces,
    photographs: Training,
    options: "RecoverOptions",
) -> list[mirror.EdgeTest]:
    """The edge test of every surface that is large and flat enough for one."""
    surface = found.surface_of_face[points.face]
    tests = [
        mirror.edge_test(
            rays, mesh, points, surface, found.surface_of_face, capture.camera, photographs.radiance, s, options.mirror
        )
        for s in range(found.num_surfaces)
    ]
    return [t for t in tests if t is not None]


def accepted_mirrors(
    mesh: PatchMesh, points: ShadingPoints, found: Surfaces, tests: list[mirror.EdgeTest], options: "RecoverOptions"
) -> tuple[Mirror, ...]:
    """The surfaces that may be mirrors by the edge test, or that a person says are; their reflectance is fitted later."""
    surface, forced, mirrors = found.surface_of_face[points.face], forced_states(found.names, options.force), []
    for t in tests:
        if forced.get(("mirror", t.surface), t.passes(options.mirror)):
            own = points.take(surface == t.surface)
            one = mirror.mirror_of(mesh, found.surface_of_face, t.surface, own, t.score, options.mirror)
            throws = one.is_plane and forced.get(("thrown", t.surface), one.throws_light)
            mirrors.append(replace(one, throws_light=throws))
    return tuple(mirrors)
