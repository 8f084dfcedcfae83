"""What effects are worth: a kept one is missed, one that brings nothing is not, and both are told apart."""

from dataclasses import replace

import numpy as np

from relight3d.evaluate.worth import HeldOut, left_out, with_effect_of, worth_of_effects
from relight3d.recover.run import recover
from relight3d.relight.force import has_effect
from relight3d.relight.options import RelightOptions
from relight3d.relight.plan import plan_of
from tests.plan.models import QUICK, plain_capture, plain_model, rich_capture, rich_model


def test_kept_effects_are_missed() -> None:
    found = {(w.effect, w.where): w for w in worth_of_effects(rich_model(), rich_capture())}
    for key in (("shadows", "scene"), ("lobes", "sphere"), ("texture", "table"), ("mirror", "mirror")):
        assert found[key].is_on and found[key].is_right and found[key].own_db > 1.0, key
    assert all(w.is_on for w in found.values()), "what was left out has no other way without a forced recovery"


def test_what_the_plain_plan_left_out_brings_nothing() -> None:
    """Held-out photographs of the plain scene are missed by a tenth of a dB more or less with every effect forced on."""
    plan = plan_of(plain_model())
    words = left_out(plan)
    assert {"indirect=on", "residual=on", "detail:1=on", "lobes:0=on"} <= set(words)
    with_all = recover(plain_capture(), replace(QUICK, force=words), quiet=True)
    found = {w.effect: w for w in worth_of_effects(plain_model(), plain_capture(), with_all) if not w.is_on}
    assert found["indirect"].is_right and found["indirect"].frame_db < 0.1
    assert found["detail"].is_right


def test_an_effect_is_carried_over_alone() -> None:
    rich = rich_model()
    bare = replace(rich, lobes=((),) * len(rich.lobes), residual=None)
    sphere = rich.surfaces.names.index("sphere")
    with_lobes = with_effect_of(bare, rich, "lobes", sphere)
    assert with_lobes.lobes[sphere] == rich.lobes[sphere] and with_lobes.residual is None
    assert has_effect(with_effect_of(bare, rich, "residual", -1), "residual", -1)
    flat = replace(rich, pixels=replace(rich.pixels, albedo=np.zeros_like(rich.pixels.albedo)))
    table = rich.pixels.surface == rich.surfaces.names.index("table")
    albedo = with_effect_of(flat, rich, "texture", rich.surfaces.names.index("table")).pixels.albedo
    assert np.array_equal(albedo[table], rich.pixels.albedo[table]) and not albedo[~table].any()


def test_a_surface_is_judged_on_its_own_pixels() -> None:
    held_out, sphere = HeldOut(rich_capture(), rich_model()), rich_model().surfaces.names.index("sphere")
    whole, own = (held_out.psnr_db(rich_model(), RelightOptions(), s) for s in (-1, sphere))
    assert len(whole) == len(own) == 4 and not np.allclose(whole, own)
