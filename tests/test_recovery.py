"""Recovery as a user runs it: its progress, its price list, what a budget gives up, effects forced on and off."""

from dataclasses import replace
from functools import cache

import pytest

import relight3d
from relight3d.errors import InputError
from relight3d.lights import DirectionalLight
from relight3d.records import RelightModel
from relight3d.recover.run import RecoverOptions
from relight3d.recovery import recover
from relight3d.relight.force import has_effect
from tests.plan.models import QUICK, plain_capture, rich_capture, rich_model

SUN = DirectionalLight((0.3, -0.4, 0.8), 3.0)


@cache
def priced() -> RelightModel:
    return recover(rich_capture(), QUICK, quiet=True)


def of(name: str) -> int:
    return rich_model().surfaces.names.index(name)


def test_the_model_has_its_prices_and_is_the_same_twice(tmp_path) -> None:
    assert priced().prices[0].name == "exact" and len(priced().prices) > 10
    again = recover(rich_capture(), QUICK, quiet=True)
    for name, model in (("a", priced()), ("b", again)):
        model.save(tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert recover(plain_capture(), replace(QUICK, prices=False), quiet=True).prices == ()


def test_progress_is_shown_unless_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    recover(plain_capture(), QUICK)
    shown = capsys.readouterr().err
    assert "recover: " in shown and " mesh\n" in shown and " 100 %  prices" in shown
    recover(plain_capture(), QUICK, quiet=True)
    assert capsys.readouterr() == ("", "")
    calls: list[tuple[str, float]] = []
    recover(plain_capture(), QUICK, progress=lambda *call: calls.append(call))
    fractions = [fraction for _, fraction in calls]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0 and calls[-1][0] == "prices"
    assert capsys.readouterr() == ("", "")


def test_without_time_rounds_residual_and_prices_are_given_up_and_named() -> None:
    hasty = recover(rich_capture(), replace(QUICK, num_rounds=2, budget_s=1e-3), quiet=True)
    assert hasty.prices == () and hasty.residual is None and not any(hasty.lobes)
    assert not any("round" in stage for stage in hasty.seconds)
    said = " ".join(w for w in hasty.warnings if "budget of 0.001 s" in w)
    for word in ("round 1 of lobes", "round 2 of lobes", "the residual", "the price list"):
        assert word in said
    assert relight3d.Relighter(hasty).render([SUN]).radiance.max() > 0
    leisurely = recover(plain_capture(), replace(QUICK, budget_s=1e6), quiet=True)
    assert leisurely.prices and not any("budget" in w for w in leisurely.warnings)


def test_rounds_end_when_one_gains_too_little() -> None:
    model = recover(rich_capture(), replace(QUICK, num_rounds=3, max_error_db=1000.0, prices=False), quiet=True)
    assert "lobes, round 1" in model.seconds and "lobes, round 2" not in model.seconds
    model = recover(rich_capture(), replace(QUICK, num_rounds=2, max_error_db=0.0, prices=False), quiet=True)
    assert "lobes, round 2" in model.seconds


def test_effects_forced_off_are_not_recovered_and_those_forced_on_are() -> None:
    force = ("lobes:sphere=off", "mirror=off", "residual=off", "ambient=off", "texture=off", "detail:table=on")
    model = recover(rich_capture(), replace(QUICK, force=force, prices=False), quiet=True)
    assert rich_model().lobes[of("sphere")] and not model.lobes[of("sphere")]
    assert rich_model().mirrors and model.mirrors == () and model.residual is None
    assert has_effect(rich_model(), "ambient", -1) and not has_effect(model, "ambient", -1)
    table = of("table")
    assert has_effect(rich_model(), "texture", table) and not has_effect(model, "texture", table)
    assert has_effect(model, "detail", table)
    lines = {(d.effect, d.surface): d for d in model.decisions}
    assert lines["texture", table].reason.startswith("forced off") and not lines["texture", table].is_on
    assert lines["detail", table].reason.startswith("forced on") and lines["detail", table].is_on


def test_indirect_light_and_residual_can_be_forced_on() -> None:
    model = recover(plain_capture(), replace(QUICK, force=("indirect=on", "residual=on"), prices=False), quiet=True)
    assert model.indirect is not None and model.residual is not None
    assert model.residual.lit_modes.shape[1] + model.residual.dark_modes.shape[1] > 0


@pytest.mark.parametrize("word", ["lobes", "gleam=on", "lobes:nowhere=on", "shadows=off", "lobe 2:sphere=off"])
def test_what_cannot_be_forced_is_refused(word: str) -> None:
    with pytest.raises(InputError, match="force"):
        recover(plain_capture(), replace(QUICK, force=(word,)), quiet=True)


@pytest.mark.parametrize("wrong", [{"budget_s": 0.0}, {"max_error_db": -1.0}, {"max_error_db": float("nan")}])
def test_a_budget_that_is_none_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        RecoverOptions(**wrong)
