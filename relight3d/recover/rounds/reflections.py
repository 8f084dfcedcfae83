"""What mirrors reflect, from the scene as recovered so far; and that scene as a model."""

from dataclasses import replace

import numpy as np

from relight3d.records import Mirror, Observations, PixelMap, RelightModel
from relight3d.recover import bounce, indirect, mirror, sites, unseen
from relight3d.recover.rounds.state import Evidence, Fitted, Stage


def fit_mirrors(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted
) -> tuple[tuple[Mirror, ...], Fitted]:
    """The mirrors with their reflectances, from what they show of the scene recovered so far; and the evidence noted."""
    if not mirrors:
        return mirrors, fitted
    from relight3d.forward import shade_points
    from relight3d.views import ViewOptions, build_view

    model = provisional_model(stage, observed, mirrors, fitted)
    view = build_view(stage.rays, model, stage.camera, ViewOptions(edge_samples=1, max_bounces=1))
    at = np.full(stage.camera.num_pixels, -1)
    at[view.points.pixel] = np.arange(len(view.points))
    found, evidence = [], dict(fitted.evidence)
    for one in mirrors:
        mine = np.flatnonzero((stage.surface == one.surface) & observed.is_interior)
        shown_at = at[stage.points.pixel[mine]]
        mine, shown_at = mine[shown_at >= 0], shown_at[shown_at >= 0]
        shown = np.empty((len(observed.lights), len(mine), 3), np.float32)
        for photo, each in enumerate(observed.lights):
            s = shade_points(stage.rays, model, view.take(shown_at), list(each))
            shown[photo] = (s.direct + s.specular + s.indirect) / observed.scale[photo]
        value, explained = mirror.fit_reflectance(shown, observed.radiance[:, mine], observed.weight[:, mine])
        gain = -10 * np.log10(max(1.0 - explained, 1e-6))
        reason = f"edges correlate by {one.score:.2f}; the reflection explains {100 * explained:.0f} % of what varies"
        evidence["mirror", one.surface] = Evidence(float(gain), 0.5, reason)
        found.append(replace(one, reflectance=value))
    return tuple(found), replace(fitted, evidence=evidence)


def proven_mirrors(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, tests: list[mirror.EdgeTest]
) -> tuple[Mirror, ...]:
    """The mirrors whose edges are sure, that a person forces, or that show what they reflect of the scene so far."""
    options = stage.options.mirror
    doubtful = {s for s in mirror.doubtful(mirrors, tests, options) if ("mirror", s) not in stage.forced}
    if not doubtful:
        return mirrors
    evidence = fit_mirrors(stage, observed, mirrors, fitted)[1].evidence
    min_gain_db = -10 * np.log10(1.0 - options.min_explained)
    return tuple(
        m for m in mirrors if m.surface not in doubtful or evidence["mirror", m.surface].gain_db >= min_gain_db
    )


def provisional_model(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted
) -> RelightModel:
    """The model so far, without background and residual."""
    assert fitted.solution is not None and fitted.design is not None, "the alternation comes first"
    found, health = indirect.indirect_of(
        fitted.solution, fitted.design, observed, stage.options.indirect.site, stage.anchors, stage.softening
    )
    # What is fitted beside the computed light comes from the surroundings: an unseen site gets what it is open to.
    openness = None if fitted.bounced is None or stage.transport is None else bounce.openness(stage.transport)
    of_face = fitted.surface_albedo.mean(axis=1)[stage.surfaces.surface_of_face]
    albedo = sites.of_faces(stage.mesh, of_face, found.site)
    found, health = sites.fill_unseen(stage.mesh, found, health, openness, albedo)
    if fitted.bounced is not None:
        found = bounce.added(found, fitted.bounced)
    num_lit = (observed.is_lit & (observed.weight > 0)).sum(axis=0).astype(np.int32)
    center = stage.mesh.center
    return RelightModel(
        camera=stage.camera,
        mesh=stage.mesh,
        surfaces=stage.surfaces,
        pixels=PixelMap(stage.points, stage.surface, fitted.albedo, fitted.normal, fitted.lobe_gain, num_lit),
        surface_albedo=fitted.surface_albedo,
        indirect=found,
        residual=None,
        background=None,
        lobes=fitted.lobes,
        mirrors=mirrors,
        lights=tuple(tuple(light.translated(center) for light in each) for each in observed.lights),
        exposure=1.0,
        decisions=(),
        health={"indirect": health},
        vertex_albedo=unseen.albedo_of_vertices(
            stage.mesh, stage.surfaces.surface_of_face, stage.panel_of_face, fitted.surface_albedo, stage.points,
            stage.surface, fitted.albedo, observed.is_interior & (num_lit > 0),
        ),
    )  # fmt: skip
