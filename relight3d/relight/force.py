"""Effects switched by hand: a model without them, so that they cost nothing, and options without them.

An effect that lives in the model (its arrays are what it costs) is removed by `apply_plan`; one that lives in the
rays of a frame (shadows, borders, outlines, a mirror in a mirror) is switched by `forced_options`.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from relight3d.effects import RAY_EFFECTS, SCENE, SCENE_EFFECTS, SURFACE_EFFECTS, Force, surfaces_named
from relight3d.errors import InputError
from relight3d.records import Decision, PixelMap, RelightModel
from relight3d.relight.options import RelightOptions

RAYS: dict[str, dict[str, object]] = {  # the options that leave each out
    "shadows": {"shadows": "off"},
    "borders": {"borders": False},
    "outlines": {"edge_samples": 1},
    "second mirror": {"max_bounces": 1},
    "soft shadows": {"light_samples": 1},
}
assert tuple(RAYS) == RAY_EFFECTS


def apply_plan(model: RelightModel, force: Force | None = None) -> RelightModel:
    """The model without the effects of the scene that its evidence speaks against, and without those forced off.

    No array of theirs is left, so no ray or kernel follows. Forcing on what the model has is no change. Raises
    InputError for an effect or surface that does not exist, and for one forced on that recovery left out: its data are
    in the photographs, not in the model.
    """
    force = force or {}
    for effect in SCENE_EFFECTS:
        if (effect, SCENE) not in force and _is_idle(model, effect):
            model = _WITHOUT[effect](model, SCENE)
    for (effect, where), is_on in force.items():
        surfaces = surfaces_named(model.surfaces.names, effect, where)
        if effect in RAY_EFFECTS:
            continue
        if is_on and where == SCENE and effect in SURFACE_EFFECTS:
            surfaces = [s for s in surfaces if _can_have(model, effect, s)] or surfaces
        for surface in surfaces:
            model = _switched(model, effect, surface, is_on)
    return model


def _is_idle(model: RelightModel, effect: str) -> bool:
    """Decided against, and yet in the model; indirect light stays where it carries the ambient light."""
    state = {d.effect: d.is_on for d in model.decisions if d.surface == SCENE}
    carries = effect == "indirect" and state.get("ambient", False)
    return not state.get(effect, True) and has_effect(model, effect, SCENE) and not carries


def forced_options(options: RelightOptions, force: Force | None = None) -> RelightOptions:
    """The options without the rays that are forced off; forced on, an effect that the options left out is back."""
    for (effect, where), is_on in (force or {}).items():
        if effect not in RAY_EFFECTS:
            continue
        if where != SCENE:
            raise InputError("force", f"{effect} of {where}", "an effect of one surface", f"{effect} is the scene's")
        without, default = RAYS[effect], RelightOptions()
        if not is_on:
            options = replace(options, **without)
        elif all(getattr(options, name) == value for name, value in without.items()):
            options = replace(options, **{name: getattr(default, name) for name in without})
    return options


def has_effect(model: RelightModel, effect: str, surface: int) -> bool:
    """Whether the model has the data of an effect (of the model, not of the rays)."""
    if effect.startswith("lobe "):
        return len(model.lobes[surface]) >= int(effect.split()[1])
    return bool(_HAS[effect](model, surface))


# ------------------------------------------------------------------------------------------------ switches


def _switched(model: RelightModel, effect: str, surface: int, is_on: bool) -> RelightModel:
    has = has_effect(model, effect, surface)
    if is_on and not has:
        if not _can_have(model, effect, surface):
            where = "" if surface == SCENE else f":{surface}"
            hint = f"recover the capture again with --force {effect}{where}=on"
            raise InputError("force", f"{effect}{where}=on", "an effect that recovery kept data for", hint)
        model = _with_thrown(model, surface, True)
    elif not is_on and has:
        model = (
            _without_lobe(model, surface, effect) if effect.startswith("lobe ") else _WITHOUT[effect](model, surface)
        )
    else:
        return model
    return replace(model, decisions=_noted(model.decisions, effect, surface, is_on))


def _can_have(model: RelightModel, effect: str, surface: int) -> bool:
    """What the model has, and the light that a plane mirror could throw: its plane is all that it takes."""
    is_plane = any(m.surface == surface and m.is_plane for m in model.mirrors)
    return has_effect(model, effect, surface) or (effect == "thrown" and is_plane)


def _noted(decisions: tuple[Decision, ...], effect: str, surface: int, is_on: bool) -> tuple[Decision, ...]:
    """The decisions with this one's state changed, its evidence kept."""
    word = "forced on" if is_on else "forced off"
    old = [d for d in decisions if (d.effect, d.surface) == (effect, surface)]
    if not old:
        return (*decisions, Decision(effect, surface, is_on, 0.0, 0.0, word))
    changed = replace(old[0], is_on=is_on, reason=f"{word}; evidence: {old[0].reason}")
    return tuple(changed if d is old[0] else d for d in decisions)


def _without_texture(model: RelightModel, surface: int) -> RelightModel:
    pixels = model.pixels
    mine = (pixels.surface == surface)[:, None]
    mean = model.surface_albedo[surface].astype(np.float32)
    vertex = model.albedo_unseen.copy()
    vertex[model.mesh.faces[model.surfaces.surface_of_face == surface]] = mean
    return replace(model, pixels=replace(pixels, albedo=np.where(mine, mean, pixels.albedo)), vertex_albedo=vertex)


def _without_detail(model: RelightModel, surface: int) -> RelightModel:
    pixels = model.pixels
    mine = pixels.surface == surface
    normal = np.where(mine[:, None], pixels.points.normal, pixels.normal)
    if not (normal != pixels.points.normal).any():
        normal = pixels.points.normal  # the very array: nothing is kept twice
    gain = np.where(mine, np.float32(1), pixels.lobe_gain)
    return replace(model, pixels=replace(pixels, normal=normal, lobe_gain=gain))


def _without_lobe(model: RelightModel, surface: int, effect: str) -> RelightModel:
    number = int(effect.split()[1]) - 1
    left = tuple(lobe for index, lobe in enumerate(model.lobes[surface]) if index != number)
    return _with_lobes(model, surface, left)


def _with_lobes(model: RelightModel, surface: int, lobes: tuple) -> RelightModel:
    return replace(model, lobes=tuple(lobes if s == surface else each for s, each in enumerate(model.lobes)))


def _without_mirror(model: RelightModel, surface: int) -> RelightModel:
    left = tuple(m for m in model.mirrors if m.surface != surface)
    return replace(model, mirrors=left, background=model.background if left else None)


def _with_thrown(model: RelightModel, surface: int, is_on: bool) -> RelightModel:
    mirrors = tuple(replace(m, throws_light=is_on) if m.surface == surface else m for m in model.mirrors)
    return replace(model, mirrors=mirrors)


def _without_ambient(model: RelightModel, _: int) -> RelightModel:
    assert model.indirect is not None
    return replace(model, indirect=replace(model.indirect, ambient=np.zeros_like(model.indirect.ambient)))


def _is_textured(model: RelightModel, surface: int) -> bool:
    albedo = model.pixels.albedo[model.pixels.surface == surface]
    return len(albedo) > 0 and bool((np.ptp(albedo, axis=0) > 1e-6 * np.abs(albedo).max()).any())


def _is_detailed(model: RelightModel, surface: int) -> bool:
    pixels: PixelMap = model.pixels
    mine = pixels.surface == surface
    return bool((pixels.normal[mine] != pixels.points.normal[mine]).any() or (pixels.lobe_gain[mine] != 1).any())


_HAS: dict[str, Callable[[RelightModel, int], object]] = {
    "texture": _is_textured,
    "lobes": lambda model, s: model.lobes[s],
    "detail": _is_detailed,
    "mirror": lambda model, s: any(m.surface == s for m in model.mirrors),
    "thrown": lambda model, s: any(m.surface == s and m.throws_light for m in model.mirrors),
    "indirect": lambda model, _: model.indirect is not None,
    "ambient": lambda model, _: model.indirect is not None and model.indirect.ambient.any(),
    "residual": lambda model, _: model.residual is not None,
    "background": lambda model, _: model.background is not None,
}
_WITHOUT: dict[str, Callable[[RelightModel, int], RelightModel]] = {
    "texture": _without_texture,
    "lobes": lambda model, s: _with_lobes(model, s, ()),
    "detail": _without_detail,
    "mirror": _without_mirror,
    "thrown": lambda model, s: _with_thrown(model, s, False),
    # The surroundings in mirrors are functions in the indirect light's own basis, and go with it.
    "indirect": lambda model, _: replace(model, indirect=None, background=None),
    "ambient": _without_ambient,
    "residual": lambda model, _: replace(model, residual=None),
    "background": lambda model, _: replace(model, background=None),
}
