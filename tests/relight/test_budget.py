"""Prices are measured on the model; a larger budget never loses more; what does not fit says so."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.errors import InputError
from relight3d.records import Price
from relight3d.relight.budget import check_wish, choose_options, front_of, options_of, preset_for, within
from relight3d.relight.calibrate import frame_clocks
from relight3d.relight.options import PRESETS, RelightOptions
from relight3d.relight.prices import joined, lights_between, measure_prices, single_steps
from relight3d.relight.relighter import Relighter
from relight3d.relight.work import KINDS, nominal_work, predicted_ms
from tests.plan.models import rich_capture, rich_model


def price(name: str, share: float, error_db: float, **options: object) -> Price:
    """A setting whose work is a share of the exact one's."""
    return Price(name, options, error_db, 40.0 - error_db, {kind: round(1000 * share) for kind in KINDS})


PRICES = (
    price("exact", 1.0, 0.0),
    price("lattice", 0.7, 0.1, shadows="adaptive"),
    price("no outlines", 0.75, 0.6, edge_samples=1),  # dominated by the lattice
    price("both", 0.45, 0.7, shadows="adaptive", edge_samples=1),
    price("few", 0.25, 2.5, shadows="adaptive", edge_samples=1, residual=False),
    price("least", 0.1, 9.0, shadows="off", edge_samples=1, residual=False),
)


def costs(exact_ms: float = 20.0) -> list[float]:
    return [exact_ms * nominal_work(p.work, PRICES[0].work) for p in PRICES]


def error_of(options: RelightOptions) -> float:
    return next(p.error_db for p in PRICES if options_of(p) == options)


def test_the_front_leaves_out_what_another_beats() -> None:
    assert [PRICES[k].name for k in front_of(PRICES, costs())] == ["least", "few", "both", "lattice", "exact"]


def test_a_larger_budget_never_loses_more() -> None:
    for exact_ms in (5.0, 20.0, 60.0):
        errors = [error_of(choose_options(PRICES, costs(exact_ms), ms)[0]) for ms in np.geomspace(0.3, 100, 60)]
        assert errors == sorted(errors, reverse=True)
        assert errors[0] == 9.0 and errors[-1] == 0.0


def test_a_slower_machine_gets_a_cheaper_setting() -> None:
    assert choose_options(PRICES, costs(20.0), 16.0)[0].shadows == "adaptive"
    assert choose_options(PRICES, costs(80.0), 16.0)[0].residual is False


def test_a_wanted_error_gets_the_cheapest_that_reaches_it() -> None:
    for wanted, error in ((0.0, 0.0), (0.65, 0.1), (1.0, 0.7), (50.0, 9.0)):
        assert error_of(choose_options(PRICES, costs(), None, wanted)[0]) == error
    options, notes = choose_options(PRICES, costs(), 6.0, 0.5)
    assert error_of(options) == 2.5 and "less than the wanted 0.5 dB" in notes[0]


def test_a_budget_below_the_cheapest_says_so() -> None:
    options, notes = choose_options(PRICES, costs(), 1.0)
    assert error_of(options) == 9.0
    assert "no setting fits the budget of 1 ms" in notes[0] and "gives up 9.00 dB" in notes[0]
    assert "no setting" not in choose_options(PRICES, costs(), 30.0)[1][0]


def test_nothing_to_choose_by_is_refused() -> None:
    for prices, budget_ms in ((PRICES, None), ((), 5.0)):
        with pytest.raises(InputError):
            choose_options(prices, costs(), budget_ms)
    with pytest.raises(InputError, match="price list"):
        Relighter(rich_model(), max_error_db=1.0)


def test_two_ways_to_settle_the_options_are_refused() -> None:
    check_wish(None, None, 5.0, 0.5)
    wrong = ((RelightOptions(), None, 5.0, None), (None, "fast", 5.0, None), (None, "fast", None, 1.0))
    for wishes in (*wrong, (None, None, -1.0, None), (None, None, None, -1.0), (None, None, None, float("nan"))):
        with pytest.raises(InputError):
            check_wish(*wishes)


def test_presets_are_points_of_the_front() -> None:
    model = replace(rich_model(), prices=PRICES)
    assert [error_of(preset_for(model, name)) for name in ("exact", "balanced", "fast")] == [0.0, 0.1, 0.7]
    assert preset_for(rich_model(), "fast") == PRESETS["fast"]  # without a list
    assert preset_for(model, "baked") == PRESETS["baked"]  # work that no frame does is on no list
    with pytest.raises(InputError):
        preset_for(model, "best")


def test_timed_frames_turn_work_into_milliseconds() -> None:
    """Costs of each kind that the timed frames tell apart are found; the others share what is left evenly."""
    exact = dict.fromkeys(KINDS, 1000)
    cheap = exact | {"shadow rays": 250, "modes": 0}
    between = exact | {"modes": 500}
    costs = {"points": 1.0, "shadow rays": 8.0, "border rays": 1.0, "lobes": 1.0, "modes": 4.0}

    def clocks(work: dict[str, int]) -> dict[str, float]:
        took = {kind: cost * work[kind] / 1000 for kind, cost in costs.items()}
        shadow = took["points"] + took["shadow rays"] + took["border rays"]
        return {
            "shadow": shadow,
            "thrown": 0.0,
            "indirect": 2.0,
            "shade": took["points"] + took["lobes"] + took["modes"],
        }

    timed = [exact, cheap]
    found = predicted_ms([exact, cheap, between], timed, [clocks(w) for w in timed], exact)
    assert found == pytest.approx([18.0, 8.0, 16.0], rel=0.02)
    one_clock = [dict.fromkeys(("shadow", "thrown", "indirect"), 0.0) | {"shade": ms} for ms in (20.0, 8.0)]
    half = predicted_ms([between], timed, one_clock, exact)[0]
    assert 8.0 < half < 20.0


def test_prices_are_of_what_the_model_has(tmp_path) -> None:
    steps = single_steps(rich_model())
    assert "no light thrown by mirrors" in steps and "one bounce between mirrors" not in steps  # one plane mirror
    prices = measure_prices(rich_model(), rich_capture())
    by_name = {p.name: p for p in prices}
    assert prices[0].name == "exact" and by_name["exact"].error_db == 0.0 and by_name["exact"].options == {}
    assert by_name["no shadows"].error_db > 1.0 and by_name["no shadows"].work["shadow rays"] == 0
    assert by_name["no light thrown by mirrors"].work["thrown rays"] == 0 < by_name["exact"].work["thrown rays"]
    assert measure_prices(rich_model(), rich_capture()) == prices, "no clock has a say"
    path = tmp_path / "priced.relight"
    replace(rich_model(), prices=prices).save(path)
    from relight3d.io.model_file import load_model

    assert load_model(path).prices == prices


def test_steps_put_together_keep_the_rougher_answer() -> None:
    assert joined({"max_modes": 3}, {"max_modes": 8, "borders": False}) == {"max_modes": 3, "borders": False}
    assert joined({"max_modes": 3}, {"residual": False}) == {"residual": False}
    lattice = {"shadows": "adaptive", "lattice_px": 4, "borders": False}
    assert joined(lattice, {"shadows": "off"}) == joined({"shadows": "off"}, lattice) == {"shadows": "off"}


def test_lights_between_are_none_of_the_photographed() -> None:
    photographed = [light for each in rich_model().lights for light in each]
    between = [each[0] for each in lights_between(rich_model())]
    assert len(between) > 2 and not any(light in photographed for light in between)


def test_a_budget_that_nothing_fits_takes_the_cheapest_and_says_so(caplog: pytest.LogCaptureFixture) -> None:
    model = replace(rich_model(), prices=measure_prices(rich_model(), rich_capture()))
    exact = Relighter(model, options=RelightOptions())
    options, notes = within(exact, 1e-3, None)
    assert options != RelightOptions() and "no setting fits" in notes[0] and notes[0] in caplog.text
    caplog.clear()
    options, notes = within(exact, 1e6, None)
    assert "gives up nothing" in notes[0] and not caplog.records
    options, notes = within(Relighter(rich_model(), options=RelightOptions()), 1e6, None)
    assert options == PRESETS["exact"] and "no price list" in notes[0]


def test_a_wanted_error_is_kept() -> None:
    model = replace(rich_model(), prices=measure_prices(rich_model(), rich_capture()))
    relighter = Relighter(model, max_error_db=1.0)
    chosen = next(p for p in model.prices if options_of(p) == relighter.options)
    assert chosen.error_db <= 1.0
    notes = relighter.render(list(model.lights[0])).stats.notes
    assert chosen.name in notes[0] and "no setting" not in notes[0]


def test_another_setting_shares_the_view_and_shows_the_same() -> None:
    exact = Relighter(rich_model(), options=RelightOptions())
    lights = list(rich_model().lights[0])
    for options in (RelightOptions(residual=False), RelightOptions(edge_samples=1), RelightOptions(detail=False)):
        shared, alone = exact.with_options(options), Relighter(rich_model(), options=options)
        assert (shared.view is exact.view) == (not options.residual)
        assert np.array_equal(shared.render(lights).radiance, alone.render(lights).radiance)
    assert exact.options == RelightOptions()


def test_the_clocks_of_a_frame_add_up_to_its_time() -> None:
    clocks = frame_clocks(Relighter(rich_model(), options=RelightOptions()))
    assert set(clocks) == {"shadow", "thrown", "indirect", "shade"} and all(ms > 0 for ms in clocks.values())


def test_half_resolution_has_a_lattice_of_its_own() -> None:
    lattice = {"shadows": "adaptive", "lattice_px": 4, "shared_rays": True, "shading": "adaptive"}
    assert joined(lattice, {"shading": "half"}) == {"shading": "half"}
    assert joined({"shading": "half"}, lattice) == {"shading": "half"}
    assert joined({"shading": "half"}, {"shadows": "off"}) == {"shading": "half", "shadows": "off"}
    assert single_steps(rich_model())["light at half resolution"] == {"shading": "half"}
