"""A plan says what runs and why; what is forced off costs no ray and no array."""

import json

import numpy as np
import pytest

from relight3d.effects import parse_force
from relight3d.errors import InputError
from relight3d.lights import DirectionalLight, SphereLight
from relight3d.relight.force import apply_plan, forced_options, has_effect
from relight3d.relight.options import RelightOptions
from relight3d.relight.plan import plan_of
from relight3d.relight.plan_lines import COLUMNS, Plan, confidence_in
from relight3d.relight.relighter import Relighter
from tests.plan.models import rich_model

SUN = DirectionalLight((0.3, -0.4, 0.8), 3.0)
BELOW = DirectionalLight((0.1, 0.2, -1.0), 3.0)


def of(name: str) -> int:
    return rich_model().surfaces.names.index(name)


def test_a_plan_survives_json() -> None:
    for plan in (plan_of(rich_model()), plan_of(rich_model(), Relighter(rich_model()), [SUN])):
        assert Plan.from_dict(json.loads(json.dumps(plan.to_dict()))) == plan
        assert all(len(row) == len(COLUMNS) for row in plan.rows()) and "confidence" in str(plan)


def test_a_plan_has_the_evidence_and_the_price_of_each_effect() -> None:
    plan = plan_of(rich_model(), Relighter(rich_model()), [SUN])
    lobes = next(o for o in plan.lines if o.effect == "lobes" and o.where == "sphere")
    assert lobes.is_on and lobes.gain_db > 1 and lobes.confidence == "strong"
    shadows = next(o for o in plan.lines if o.effect == "shadows")
    parts = [o for o in plan.lines if o.effect == "direct"]
    assert shadows.rays == plan.rays["shadow"] > 0 and 0 < shadows.share < 1
    assert sum(o.rays for o in parts) == pytest.approx(shadows.rays, abs=len(parts))
    assert 0 < sum(o.share for o in parts) <= 1


def test_a_light_below_everything_casts_no_ray() -> None:
    plan = plan_of(rich_model(), Relighter(rich_model(), options=RelightOptions(thrown=False)), [BELOW])
    above = [o.where for o in plan.lines if o.effect == "direct" and o.is_on]
    assert sum(plan.rays.values()) == 0 or above, "only a point that faces the light asks"
    plan = plan_of(rich_model(), Relighter(rich_model()), [])
    assert sum(plan.rays.values()) == 0 and "no light: no ray" in plan.facts


def test_options_show_in_the_plan() -> None:
    options = RelightOptions(shadows="off", max_bounces=0, residual=False, max_lobes=1, edge_samples=1)
    plan = plan_of(rich_model(), Relighter(rich_model(), options=options))
    off = ("shadows", "borders", "mirror", "residual", "outlines", "background")
    assert not any(plan.is_on(effect) for effect in off)
    assert "no mirror is in view: no bounce" in plan.facts
    assert not plan.is_on("lobe 2") and plan.is_on("lobes", of("sphere"))


def test_soft_shadows_are_on_for_a_light_with_an_extent() -> None:
    lamp = SphereLight((0.3, -0.4, 2.0), (1.0, 1.0, 1.0), 0.2)
    plan = plan_of(rich_model(), Relighter(rich_model(), options=RelightOptions(light_samples=4)), [lamp])
    assert plan.is_on("soft shadows") and not plan_of(rich_model(), Relighter(rich_model()), [SUN]).is_on(
        "soft shadows"
    )


@pytest.mark.parametrize("effect", ["texture", "lobes", "mirror", "thrown", "indirect", "ambient", "residual"])
def test_forced_off_an_effect_is_gone_and_nothing_else(effect: str) -> None:
    model = rich_model()
    surfaces = [s for s in range(model.surfaces.num_surfaces) if has_effect(model, effect, s)]
    where = surfaces[0] if effect in ("texture", "lobes", "mirror", "thrown") else -1
    without = apply_plan(model, {(effect, where): False})
    assert not has_effect(without, effect, where) and has_effect(model, effect, where)
    assert not plan_of(without).is_on(effect, where)
    others = {"texture", "lobes", "ambient", "residual"} - {effect, "ambient" if effect == "indirect" else ""}
    assert all(has_effect(without, o, s) == has_effect(model, o, s) for o in others for s in range(2) if o != "ambient")


def test_an_absent_effect_has_no_ray_and_no_array() -> None:
    model = rich_model()
    off = {(e, -1): False for e in ("mirror", "indirect", "residual", "lobes", "detail", "texture")}
    bare = apply_plan(model, off)
    assert bare.indirect is None and bare.residual is None and bare.background is None and not any(bare.lobes)
    assert bare.pixels.normal is bare.pixels.points.normal and bare.mirrors == ()
    options = forced_options(RelightOptions(), parse_force(["shadows=off", "outlines=off"]))
    relighter = Relighter(bare, options=options)
    assert relighter.render([SUN]).stats.num_rays == 0 and relighter.view.num_rays == 0
    assert not relighter.view.is_mirrored.any()
    full = Relighter(model).render([SUN]).stats.rays
    assert full["thrown"] > 0 and Relighter(bare).render([SUN]).stats.rays["thrown"] == 0


def test_one_lobe_can_be_taken_out() -> None:
    sphere, model = of("sphere"), rich_model()
    second = apply_plan(model, {("lobe 1", "sphere"): False})
    assert second.lobes[sphere] == model.lobes[sphere][1:]


def test_forced_on_what_is_there_changes_nothing_and_what_is_not_says_what_to_do() -> None:
    model = rich_model()
    assert apply_plan(model, {("lobes", "sphere"): True, ("texture", -1): True}) is model
    dark = apply_plan(model, {("thrown", "mirror"): False})
    assert has_effect(apply_plan(dark, {("thrown", "mirror"): True}), "thrown", of("mirror"))
    with pytest.raises(InputError, match="recover the capture again with --force lobes:0=on"):
        apply_plan(model, {("lobes", "table"): True})


@pytest.mark.parametrize("word", ["gloss=off", "lobes", "lobes:moon=off", "indirect:table=off", "lobes:99=off"])
def test_what_does_not_exist_cannot_be_forced(word: str) -> None:
    with pytest.raises(InputError):
        apply_plan(rich_model(), parse_force([word]))


def test_shadows_looked_up_have_borders() -> None:
    options = RelightOptions(shading="half", shadows="table", table_directions=256)
    on = {line.effect: line.is_on for line in Relighter(rich_model(), options=options).plan.lines}
    assert on["shadows"] and on["borders"]
    off = Relighter(rich_model(), options=RelightOptions(shadows="off")).plan.lines
    assert not any(line.is_on for line in off if line.effect in ("shadows", "borders"))


def test_rays_are_forced_by_options() -> None:
    force = parse_force(["borders=off", "second mirror=off"])
    options = forced_options(RelightOptions(), force)
    assert not options.borders and options.max_bounces == 1 and apply_plan(rich_model(), force) is rich_model()
    assert forced_options(options, parse_force(["borders=on"])).borders
    with pytest.raises(InputError):
        forced_options(RelightOptions(), {("shadows", 0): False})


def test_confidence_in_words() -> None:
    words = [confidence_in(True, 5.0, 0.5), confidence_in(True, 1.5, 0.5), confidence_in(True, 0.6, 0.5)]
    assert words == ["strong", "clear", "weak"]
    assert confidence_in(False, -0.1, 0.5) == "no gain" and confidence_in(False, 0.3, 0.5) == "within the noise"
    assert np.isfinite([o.gain_db or 0.0 for o in plan_of(rich_model()).lines]).all()
