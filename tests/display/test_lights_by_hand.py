"""Lights on the dome, in the rack and in the picture: where they go, and how bright they stay."""

import numpy as np
import pytest

from relight3d.display.gizmo import Gizmo
from relight3d.display.light_dome import LightDome, dome_picture
from relight3d.display.light_rack import LightRack
from relight3d.lights import DirectionalLight, PointLight, SpotLight
from relight3d.records import RelightModel

SUN = DirectionalLight((0.3, -0.4, 0.8), (3.0, 2.0, 1.0))


@pytest.fixture(scope="module")
def dome(model: RelightModel) -> LightDome:
    return LightDome.of(model)


@pytest.fixture(scope="module")
def gizmo(model: RelightModel, dome: LightDome) -> Gizmo:
    return Gizmo(dome, model.camera, model.mesh.center)


def middle_irradiance(dome: LightDome, light: DirectionalLight | PointLight) -> float:
    return float(light.incident(dome.center[None]).irradiance[0].max())


def test_the_dome_stands_over_the_photographed_lights(dome: LightDome):
    assert dome.pole[2] > 0.8  # the rig is a hemisphere about z
    np.testing.assert_allclose([dome.pole @ dome.right, dome.pole @ dome.ahead], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(dome.right, dome.ahead), dome.pole, atol=1e-12)


def test_a_model_without_lights_has_its_dome_towards_the_camera(model: RelightModel):
    from dataclasses import replace

    dome = LightDome.of(replace(model, lights=()))
    toward = model.camera.center - model.mesh.center
    np.testing.assert_allclose(dome.pole, toward / np.linalg.norm(toward))


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.5, 0.2), (-0.7, -0.7), (0.0, 1.0)])
def test_places_on_the_disc_and_directions_are_one_to_one(dome: LightDome, place: tuple[float, float]):
    direction = dome.direction_on_disc(*place)
    np.testing.assert_allclose(np.linalg.norm(direction), 1.0)
    np.testing.assert_allclose(dome.place_on_disc(direction), place, atol=1e-9)


def test_a_lamp_keeps_its_distance_when_turned_and_its_light_when_moved(dome: LightDome):
    lamp = PointLight((1.0, 1.0, 2.0), (4.0, 4.0, 4.0))
    turned = dome.turned_to(lamp, dome.right)
    np.testing.assert_allclose(dome.distance_of(turned), dome.distance_of(lamp))
    np.testing.assert_allclose(dome.direction_of(turned), dome.right, atol=1e-9)
    nearer = dome.at_distance(lamp, 0.5 * dome.distance_of(lamp))
    np.testing.assert_allclose(middle_irradiance(dome, nearer), middle_irradiance(dome, lamp), rtol=1e-9)
    assert dome.at_distance(SUN, 1.0) is SUN


def test_new_lights_start_apart_and_as_bright(dome: LightDome):
    rack = LightRack.of(dome, [SUN]).add("point").add("directional")
    assert [entry.base.kind for entry in rack.entries] == ["directional", "point", "directional"]
    places = [dome.place_on_disc(dome.direction_of(light)) for light, _ in rack.shown]
    assert min(np.hypot(*np.subtract(places[i], places[j])) for i, j in ((0, 1), (0, 2), (1, 2))) > 0.1
    np.testing.assert_allclose(middle_irradiance(dome, rack.entries[1].light), 3.0)


def test_an_entry_shines_as_the_light_it_was_made_of(dome: LightDome):
    spot = SpotLight((0.0, 0.0, 3.0), (0.0, 0.0, -1.0), (1.0, 0.5, 0.0))
    for light in (SUN, spot, PointLight((0, 0, 2), (2.0, 2.0, 2.0))):
        np.testing.assert_allclose(LightRack.of(dome, [light]).active[0].power, light.power, atol=2e-3)
    black = LightRack.of(dome, [DirectionalLight((0, 0, 1), 0.0)])
    assert (black.active[0].power == 0).all() and (black.strengthen(1.0).active[0].power > 0).all()


def test_the_rack_switches_colours_and_removes(dome: LightDome):
    rack = LightRack.of(dome, [SUN]).add("point")
    assert rack.selected == 1 and len(rack.active) == 2
    assert len(rack.switch(False).active) == 1
    red = rack.tint(1.0, 0.0, 0.0).active[1].power
    assert red[0] > 0 and red[1] < 2e-3 * red[0]
    np.testing.assert_allclose(rack.strengthen(2.0).active[1].power, 2 * rack.active[1].power)
    empty = rack.remove().remove().remove()
    assert empty.entries == () and empty.current is None and empty.turn(0.1, 0.1).active == ()
    assert empty.add("directional").active


def test_a_knob_is_picked_and_turned_on_the_disc(dome: LightDome):
    rack = LightRack.of(dome, [SUN]).add("point")
    for index, (light, _) in enumerate(rack.shown):
        assert rack.pick_on_disc(*dome.place_on_disc(dome.direction_of(light))) == index
    assert rack.pick_on_disc(0.99, -0.99) is None
    moved = rack.turn(0.2, -0.3)
    np.testing.assert_allclose(dome.place_on_disc(dome.direction_of(moved.active[1])), (0.2, -0.3), atol=1e-9)
    assert moved.active[0].power is not None and moved.entries[0] is rack.entries[0]


@pytest.mark.parametrize("place", [(32.0, 20.0), (20.0, 26.0), (45.0, 22.0)])
def test_a_dragged_knob_is_under_the_pointer(gizmo: Gizmo, place: tuple[float, float]):
    for light in (SUN, PointLight(tuple(gizmo.center + np.array([0.2, 0.1, 0.6])), (2.0, 2.0, 2.0))):
        moved = gizmo.dragged(light, *place)
        np.testing.assert_allclose(gizmo.knob(moved), place, atol=1e-6)
        assert gizmo.pick([SUN.scaled(0.5), moved], *place, reach_px=1.0) == 1


def test_a_pointer_beside_the_dome_stays_on_its_rim(gizmo: Gizmo, dome: LightDome):
    for place in ((-500.0, 20.0), (500.0, 500.0), (32.0, -900.0)):
        direction = dome.direction_of(gizmo.dragged(SUN, *place))
        assert np.isfinite(direction).all() and np.degrees(np.arccos(direction @ dome.pole)) <= 95.0 + 1e-6


def test_a_lamp_in_sight_keeps_its_depth(gizmo: Gizmo):
    lamp = PointLight(tuple(gizmo.center + np.array([0.0, 0.0, 0.4])), (1.0, 1.0, 1.0))
    moved = gizmo.dragged(lamp, 25.0, 18.0)
    _, before = gizmo.camera.project(np.array([lamp.position]))
    _, after = gizmo.camera.project(np.array([moved.position]))
    np.testing.assert_allclose(before, after)


def test_the_pictures_show_the_knobs(gizmo: Gizmo, dome: LightDome):
    lights = [(SUN, True), (PointLight((0.5, 0.5, 1.0), (1.0, 0.2, 0.2)), False)]
    disc = dome_picture(dome, lights, 0, [dome.pole], 120)
    assert disc.shape == (120, 120, 3) and disc.max() > 200
    black = np.zeros((96, 128, 3), np.uint8)  # twice the camera's size
    drawn = gizmo.drawn(black, lights, 0)
    x, y = (int(2 * c) for c in gizmo.knob(SUN))
    assert drawn.shape == black.shape and drawn[y, x].max() > 200 and (drawn == 0).mean() > 0.5
