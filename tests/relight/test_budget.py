"""Prices are measured on the model; a larger budget never loses more; what does not fit says so."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.errors import InputError
from relight3d.relight.budget import choose_options, front_of, one_of_three, preset_for, within_budget
from relight3d.relight.options import PRESETS, RelightOptions
from relight3d.relight.prices import joined, lights_between, measure_prices, single_steps
from relight3d.relight.relighter import Relighter
from tests.plan.models import rich_capture, rich_model


def price(name: str, milliseconds: float, error_db: float, **options: object) -> dict:
    return {"name": name, "options": options, "milliseconds": milliseconds, "exact_ms": 20.0, "error_db": error_db}


PRICES = (
    price("exact", 20.0, 0.0),
    price("lattice", 14.0, 0.1, shadows="adaptive"),
    price("no outlines", 15.0, 0.6, edge_samples=1),  # dominated by the lattice
    price("both", 9.0, 0.7, shadows="adaptive", edge_samples=1),
    price("few", 5.0, 2.5, shadows="adaptive", edge_samples=1, residual=False),
    price("least", 2.0, 9.0, shadows="off", edge_samples=1, residual=False),
)


def error_of(options: RelightOptions) -> float:
    return next(p["error_db"] for p in PRICES if replace(RelightOptions(), **p["options"]) == options)


def test_the_front_leaves_out_what_another_beats() -> None:
    assert [p["name"] for p in front_of(PRICES)] == ["least", "few", "both", "lattice", "exact"]


def test_a_larger_budget_never_loses_more() -> None:
    for scale in (0.25, 1.0, 3.0):
        errors = [error_of(choose_options(PRICES, ms, None, scale)[0]) for ms in np.geomspace(0.3, 100, 60)]
        assert errors == sorted(errors, reverse=True)
        assert errors[0] == 9.0 and errors[-1] == 0.0


def test_a_slower_machine_gets_a_cheaper_setting() -> None:
    assert choose_options(PRICES, 16.0, None, 1.0)[0].shadows == "adaptive"
    assert choose_options(PRICES, 16.0, None, 4.0)[0].residual is False


def test_a_wanted_error_gets_the_cheapest_that_reaches_it() -> None:
    for wanted, error in ((0.0, 0.0), (0.65, 0.1), (1.0, 0.7), (50.0, 9.0)):
        assert error_of(choose_options(PRICES, None, wanted)[0]) == error
    options, notes = choose_options(PRICES, 6.0, 0.5)
    assert error_of(options) == 2.5 and "less than the wanted 0.5 dB" in notes[0]


def test_a_budget_below_the_cheapest_says_so() -> None:
    options, notes = choose_options(PRICES, 1.0)
    assert error_of(options) == 9.0
    assert "no setting fits the budget of 1 ms" in notes[0] and "gives up 9.00 dB" in notes[0]
    assert "no setting" not in choose_options(PRICES, 30.0)[1][0]


@pytest.mark.parametrize("wanted", [{}, {"prices": ()}])
def test_nothing_to_choose_by_is_refused(wanted: dict) -> None:
    with pytest.raises(InputError):
        choose_options(wanted.get("prices", PRICES), None if not wanted else 5.0)


def test_two_ways_to_settle_the_options_are_refused() -> None:
    one_of_three(None, 5.0, None)
    for options, budget, preset in ((RelightOptions(), 5.0, None), (None, 5.0, "fast"), (None, -1.0, None)):
        with pytest.raises(InputError):
            one_of_three(options, budget, preset)


def test_presets_are_points_of_the_front() -> None:
    model = replace(rich_model(), prices=PRICES)
    assert [error_of(preset_for(model, name)) for name in ("exact", "balanced", "fast")] == [0.0, 0.1, 2.5]
    assert preset_for(rich_model(), "fast") == PRESETS["fast"]  # without a list
    with pytest.raises(InputError):
        preset_for(model, "best")


def test_prices_are_of_what_the_model_has(tmp_path) -> None:
    steps = single_steps(rich_model())
    assert "no light thrown by mirrors" in steps and "one bounce between mirrors" not in steps  # one plane mirror
    prices = measure_prices(rich_model(), rich_capture())
    by_name = {p["name"]: p for p in prices}
    assert by_name["exact"]["error_db"] == 0.0 and by_name["exact"]["options"] == {}
    assert by_name["no shadows"]["error_db"] > 1.0 and by_name["no shadows"]["rays"] < by_name["exact"]["rays"]
    assert by_name["residual in int16"]["error_db"] < 0.05  # steps of 1/32767 of a mode's peak
    path = tmp_path / "priced.relight"
    replace(rich_model(), prices=prices).save(path)
    from relight3d.io.model_file import load_model

    assert load_model(path).prices == prices


def test_steps_put_together_keep_the_rougher_answer() -> None:
    assert joined({"max_modes": 3}, {"max_modes": 8, "borders": False}) == {"max_modes": 3, "borders": False}
    assert joined({"precision": "int16", "max_modes": 3}, {"residual": False}) == {"residual": False}
    lattice = {"shadows": "adaptive", "lattice_px": 4, "borders": False}
    assert joined(lattice, {"shadows": "off"}) == joined({"shadows": "off"}, lattice) == {"shadows": "off"}


def test_no_setting_is_begun_after_the_time_is_up() -> None:
    assert len(measure_prices(rich_model(), rich_capture(), max_seconds=0.0)) == 1


def test_lights_between_are_none_of_the_photographed() -> None:
    photographed = [light for each in rich_model().lights for light in each]
    between = [each[0] for each in lights_between(rich_model())]
    assert len(between) > 2 and not any(light in photographed for light in between)


def test_a_budget_that_nothing_fits_takes_the_cheapest_and_says_so() -> None:
    model = replace(rich_model(), prices=PRICES)
    options, notes = within_budget(Relighter(model, options=RelightOptions()), 1e-3)
    assert options.residual is False and "no setting fits" in notes[0]
    options, notes = within_budget(Relighter(model, options=RelightOptions()), 1e6)
    assert options == RelightOptions() and "gives up nothing" in notes[0]
    options, notes = within_budget(Relighter(rich_model(), options=RelightOptions()), 1e6)
    assert options == PRESETS["exact"] and "no price list" in notes[0]
