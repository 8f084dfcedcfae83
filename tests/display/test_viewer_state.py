"""What the viewer shows and how it answers, without a window."""

from collections.abc import Callable

import numpy as np
import pytest

from relight3d.display.effects import PRESETS, effects_of
from relight3d.display.frames import show_frame_u8
from relight3d.display.layers import layer
from relight3d.display.viewer_state import ViewerState, fitted_box
from relight3d.errors import InputError
from relight3d.lights import DirectionalLight
from relight3d.records import Capture, RelightModel
from relight3d.relight.relighter import Relighter
from tests.display.test_pixel_report import pixel_of
from tests.scenes import HEIGHT, WIDTH

LIGHTS = (DirectionalLight((0.4, -0.5, 0.8), (2.5, 2.5, 2.5)),)


@pytest.fixture
def state(model: RelightModel, capture: Capture) -> ViewerState:
    return ViewerState(model, capture, LIGHTS)


def test_the_picture_is_the_relighters(state: ViewerState, model: RelightModel):
    assert (state.picture() == show_frame_u8(Relighter(model).render(LIGHTS))).all()


def test_moving_a_light_changes_it_as_the_relighter_says(state: ViewerState, model: RelightModel):
    before = state.picture()
    state.rack = state.rack.turn(-0.6, 0.2)
    after = state.picture()
    assert (before != after).any()
    assert (after == show_frame_u8(Relighter(model).render(state.rack.active))).all()


def test_nothing_is_rendered_twice(state: ViewerState):
    frame, picture = state.frame(), state.picture()
    assert state.frame() is frame and state.picture() is picture
    state.exposure_stops = 1.0
    assert state.frame() is frame and state.picture() is not picture


def test_exposure_is_in_stops(state: ViewerState, model: RelightModel):
    state.exposure_stops = -2.0
    assert (state.picture() == show_frame_u8(state.frame().radiance, model.exposure / 4)).all()


def test_another_camera_sees_what_its_relighter_says(state: ViewerState, model: RelightModel):
    state.orbit(9.0, 4.0)
    assert not state.is_captured_view
    assert (state.picture() == show_frame_u8(Relighter(model, state.camera).render(LIGHTS))).all()
    state.zoom(1.0)
    state.pan(2.0, 1.0)
    assert state.picture().shape == (HEIGHT, WIDTH, 3)
    state.reset_camera()
    assert state.camera is model.camera


def test_a_drag_to_the_right_turns_the_scene_to_the_right(state: ViewerState, model: RelightModel):
    # A point of the box in front of the pivot follows the pointer.
    near = state.pivot + 0.3 * (model.camera.center - state.pivot) / np.linalg.norm(model.camera.center - state.pivot)
    before = state.camera.project(near[None])[0][0]
    state.orbit(5.0, 0.0)
    assert state.camera.project(near[None])[0][0][0] > before[0] + 1.0


def test_effects_can_be_left_out_with_their_cost(state: ViewerState, model: RelightModel):
    assert set(state.effects) == set(effects_of(model)) >= {"shadows", "indirect", "lobes", "mirror"}
    with_all = state.picture()
    state.switch_effect("shadows", False)
    without = state.picture()
    assert state.frame().stats.rays.get("shadow", 0) == 0 and with_all.astype(int).sum() < without.astype(int).sum()
    state.switch_effect("shadows", True)
    assert (state.picture() == with_all).all()


def test_shares_are_found_one_by_one(state: ViewerState):
    state.rack = state.rack.turn(0.5, 0.5)
    assert state.shares() == {}
    while state.measure_next_share():
        pass
    shares = state.shares()
    assert set(shares) == set(state.effects) and all(share >= 0 for share in shares.values())
    assert shares["indirect"] > 1.0  # an ambient irradiance of 0.2 against some 2.5 of direct light
    state.rack = state.rack.turn(-0.5, 0.5)
    assert state.shares() == {}


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_make_the_frames_of_their_options(state: ViewerState, model: RelightModel, preset: str):
    state.set_speed(preset)
    wanted = Relighter(model, preset=preset).render(LIGHTS)
    assert (
        np.abs(state.picture().astype(int) - show_frame_u8(wanted)).max() <= 1
    )  # a table is the same but for rounding
    assert state.cost_lines()[0].startswith("frame: ")


def test_a_budget_chooses_settings(state: ViewerState):
    state.set_speed("exact", 1000.0)
    assert state.picture().any() and state.maker().options is not None


def test_layers_are_shown_and_laid_over_the_scene(state: ViewerState, model: RelightModel, capture: Capture):
    state.set_layer("surfaces")
    assert (state.picture() == layer(model, "surfaces", capture).image).all()
    assert any("material" in line for line in state.layer_lines())
    state.orbit(8.0, 0.0)
    colors = {tuple(color) for color in state.picture().reshape(-1, 3).tolist()}
    assert {swatch.color for swatch in state.layer().legend} <= colors
    state.set_layer("direct")
    assert state.picture().shape == (HEIGHT, WIDTH, 3) and state.layer_lines()
    with pytest.raises(InputError, match="layer"):
        state.set_layer("no such layer")


def test_without_a_capture_the_menu_has_no_evidence(model: RelightModel):
    names = ViewerState(model).names_of_layers
    assert names[0] == "relit" and "residual" not in names and len(set(names)) == len(names)


@pytest.mark.parametrize("move", [lambda state: None, lambda state: state.orbit(6.0, 2.0)])
def test_a_click_looks_at_the_pixel_of_that_spot(state: ViewerState, model: RelightModel, move: Callable):
    column, row = pixel_of(model, "sphere")
    place = model.pixels.points.position[np.flatnonzero(model.pixels.points.pixel == row * WIDTH + column)[0]]
    move(state)
    x, y = state.camera.project((place + model.mesh.center)[None].astype(np.float64))[0][0]
    state.inspect(x, y)
    assert state.pixel is not None and state.pixel.surface == "sphere"
    assert abs(state.pixel.x - column) <= 1 and abs(state.pixel.y - row) <= 1


def test_a_click_beside_the_scene_says_so(state: ViewerState):
    state.inspect(0.0, 0.0)
    assert state.pixel is None and "pixel (0, 0)" in state.message


def test_the_quick_mesh_view_has_the_pictures_colours(state: ViewerState, model: RelightModel):
    colors = state.quick_colors()
    assert colors.shape == (len(model.mesh.vertices), 3) and colors.min() >= 0 and colors.max() <= 1
    state.set_layer("coefficients")  # a sheet, which cannot be laid over anything
    assert np.ptp(state.quick_colors()) < 0.2


def test_no_light_at_all_is_a_dark_scene_and_no_error(model: RelightModel):
    state = ViewerState(model, None, ())
    assert state.picture().mean() < 80 and state.display(200, 150)[0].shape == (150, 200, 3)


@pytest.mark.parametrize(
    ("size", "box"), [((128, 96), (0, 0, 128, 96)), ((200, 96), (36, 0, 128, 96)), ((64, 96), (0, 24, 64, 48))]
)
def test_the_picture_is_fitted_into_the_window(state: ViewerState, size: tuple, box: tuple):
    assert fitted_box(WIDTH, HEIGHT, *size) == box
    canvas, found = state.display(*size)
    assert canvas.shape == (size[1], size[0], 3) and found == box


def test_the_window_shows_the_pixels_themselves_at_a_whole_scale(state: ViewerState):
    state.shows_gizmo = False
    canvas, _ = state.display(3 * WIDTH, 3 * HEIGHT)
    assert (canvas[::3, ::3] == state.picture()).all() and (canvas[2::3, 1::3] == state.picture()).all()
    state.shows_gizmo = True
    assert (state.display(3 * WIDTH, 3 * HEIGHT)[0] != canvas).any()
