"""Every layer can be made, and shows what it says."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.camera import Camera
from relight3d.display.layers import LAYERS, layer, layer_kind, layer_names, paint_layer
from relight3d.display.pictures import BAD, EMPTY, GOOD, LIT, SHADOWED, UNKNOWN, WEAK
from relight3d.display.subject import Subject
from relight3d.errors import InputError
from relight3d.maths.color import display_u8
from relight3d.records import Capture, RelightModel
from tests.scenes import HEIGHT, WIDTH, desk_truth

ALL = (*LAYERS, "status:indirect", "rank:indirect", "condition:indirect", "status:lobes")
GRIDS = ("photographs", "residual_photographs", "coefficients")


def of_surface(subject: Subject, image: np.ndarray, name: str) -> np.ndarray:
    """The values of a picture at the pixels of one surface."""
    model = subject.model
    mine = model.pixels.surface == model.surfaces.names.index(name)
    return image.reshape(-1, *image.shape[2:])[model.pixels.points.pixel[mine]]


@pytest.mark.parametrize("name", ALL)
def test_a_layer_is_a_picture_with_words_and_finite_numbers(name: str, subject: Subject):
    shown = paint_layer(subject, name)
    assert shown.image.dtype == np.uint8 and shown.image.shape[2] == 3
    if name not in GRIDS:
        assert shown.image.shape == (HEIGHT, WIDTH, 3)
    assert shown.title and shown.caption.endswith(".")
    assert shown.values is not None or name == "faces"
    # NaN stands for nothing known; infinity would spoil a scale.
    assert shown.values is None or not np.isinf(shown.values).any()
    assert np.ptp(shown.image.reshape(-1, 3), axis=0).max() > 0  # it shows something
    assert name.partition(":")[0] in repr(shown)


@pytest.mark.parametrize("name", ["surfaces", "residual", "coefficients"])
def test_a_layer_is_a_figure_too(name: str, subject: Subject):
    from relight3d.display.pixel_figure import pixels_of

    pixels = pixels_of(paint_layer(subject, name).figure())
    assert pixels.shape[1] > 600 and np.ptp(pixels) == 255


def test_names_are_those_that_can_be_made(model: RelightModel):
    names = layer_names(model)
    assert set(LAYERS) <= set(names) and "condition:lobes" in names
    without_capture = layer_names(model, has_capture=False)
    assert "residual" not in without_capture and "albedo" in without_capture
    assert "irradiance" not in layer_names(replace(model, indirect=None))


def test_an_unknown_layer_says_which_there_are(model: RelightModel):
    with pytest.raises(InputError, match="normals_mesh"):
        layer(model, "shiny")
    with pytest.raises(InputError, match="indirect"):
        layer(model, "status:shiny")


def test_evidence_needs_the_capture_it_was_read_from(model: RelightModel, capture: Capture):
    with pytest.raises(InputError, match="no capture"):
        layer(model, "shadow_borders")
    fewer = replace(capture, photographs=capture.photographs[1:])
    with pytest.raises(InputError, match="training photographs"):
        layer(model, "residual", fewer)


def test_surfaces_have_one_colour_each_and_a_legend(subject: Subject):
    shown = paint_layer(subject, "surfaces")
    colors = {swatch.label.partition(":")[0]: swatch.color for swatch in shown.legend}
    assert set(colors) == set(subject.model.surfaces.names)
    for name, color in colors.items():
        assert (of_surface(subject, shown.image, name) == color).all()
    assert (shown.image[~desk_truth(mirror=True).is_hit] == EMPTY).all()


def test_the_normals_of_a_plane_are_one_colour(subject: Subject):
    for name in ("normals_mesh", "normals"):
        shown = paint_layer(subject, name)
        assert len(np.unique(of_surface(subject, shown.image, "table"), axis=0)) == 1
        assert len(np.unique(of_surface(subject, shown.image, "sphere"), axis=0)) > 20
    assert shown.values is not None
    camera = subject.model.camera
    up = np.array([0.0, 0.0, 1.0]) @ camera.world_from_camera[:3, :3]  # of the table, in the camera's axes
    assert up[1] > 0.3 and up[2] > 0.3  # seen from in front and above: green and blue
    np.testing.assert_allclose(of_surface(subject, shown.values, "table")[0], up, atol=1e-5)
    lengths = np.linalg.norm(shown.values[desk_truth(mirror=True).is_hit], axis=-1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-5)  # float32 normals


def test_albedo_is_the_truth_encoded_for_a_screen(subject: Subject):
    shown = paint_layer(subject, "albedo")
    truth = display_u8(desk_truth(glossy=True, textured=True, mirror=True).albedo)
    for name in ("table", "box", "sphere"):
        assert (of_surface(subject, shown.image, name) == of_surface(subject, truth, name)).all()


def test_lobes_are_shown_where_they_are(subject: Subject):
    width = paint_layer(subject, "lobe_width").values
    # 0.5 ** (1 / 30) is the cosine at which the sphere's lobe has fallen to one half.
    half = np.degrees(np.arccos(0.5 ** (1 / 30)))
    np.testing.assert_allclose(of_surface(subject, width, "sphere"), half, rtol=1e-5)
    assert np.isnan(of_surface(subject, width, "table")).all()


def test_terms_add_up_to_the_relit_frame(subject: Subject):
    total = sum(paint_layer(subject, name).values for name in ("direct", "specular", "indirect", "mirror"))
    relit = paint_layer(subject, "relit").values
    np.testing.assert_allclose(np.maximum(total, 0), relit, atol=2e-5 * float(relit.max()))  # two float32 paths


def test_shadows_are_where_the_direct_light_is_not(subject: Subject):
    shadows, direct = paint_layer(subject, "shadows"), paint_layer(subject, "direct").values
    lit = of_surface(subject, np.all(shadows.image == LIT, axis=-1), "table")
    dark = of_surface(subject, np.all(shadows.image == SHADOWED, axis=-1), "table")
    assert (lit ^ dark).all() and lit.any() and dark.any()
    light = of_surface(subject, direct.sum(axis=-1), "table")
    # Pixels on a shadow's border or an object's outline see a part of the light: 2 in 100 may disagree.
    assert np.mean((light > 0.5 * np.median(light[lit])) == lit) > 0.9
    assert np.median(light[dark]) == 0.0


def test_irradiance_is_the_ambient_light_in_a_scene_without_bounces(subject: Subject):
    for name in ("irradiance", "ambient"):
        values = paint_layer(subject, name).values
        np.testing.assert_allclose(values[np.isfinite(values)], 0.2, rtol=1e-6)


def test_the_residual_of_the_true_model_is_nothing(subject: Subject):
    values = paint_layer(subject, "residual").values
    # Outlines and shadow borders are antialiased by other samples; within surfaces a display shows no difference.
    assert np.nanmedian(values) < 1e-3
    doubled = replace(subject.model, pixels=replace(subject.model.pixels, albedo=2 * subject.model.pixels.albedo))
    assert np.nanmedian(layer(doubled, "residual", subject.capture).values) > 0.05


def test_border_pairs_have_a_bright_side(subject: Subject):
    counts = paint_layer(subject, "shadow_borders").values
    assert counts[..., 0].sum() == counts[..., 1].sum() > 50
    assert of_surface(subject, counts, "mirror").sum() <= 0.2 * counts.sum()


def test_the_mirror_passes_its_edge_test(subject: Subject):
    note = paint_layer(subject, "mirror_edges").note
    assert "mirror" in note and "a mirror" in note and "table" in note


def test_trust_tells_what_was_never_lit(model: RelightModel):
    num_lit = np.full_like(model.pixels.num_lit, 9)
    num_lit[model.pixels.surface == 0], num_lit[model.pixels.surface == 1] = 0, 1
    subject = Subject(replace(model, pixels=replace(model.pixels, num_lit=num_lit)))
    image = paint_layer(subject, "trust").image
    for name, color in (("table", BAD), ("box", WEAK), ("sphere", GOOD)):
        # An outline's pixel may show the surface behind.
        assert np.mean(np.all(of_surface(subject, image, name) == color, axis=-1)) > 0.85
    assert np.all(of_surface(subject, image, "mirror") == UNKNOWN, axis=-1).any()  # what the camera saw only there


def test_trust_says_how_far_the_light_is_from_photographed_ones(model: RelightModel):
    known = model.lights[0]
    assert layer(model, "trust", lights=known).note.startswith("0°")
    opposite = replace(known[0], to_light=tuple(-np.array(known[0].to_light)))
    far = int(layer(model, "trust", lights=(opposite,)).note.partition("°")[0])
    assert far > 60


def test_status_shows_where_fits_are_weak(subject: Subject):
    shown = paint_layer(subject, "status:indirect")
    assert {swatch.label for swatch in shown.legend} == {"ok", "no data"}
    model = subject.model
    weak = model.pixels.points.face < len(model.mesh.faces) // 2
    colors = shown.image.reshape(-1, 3)[model.pixels.points.pixel]
    assert (colors[weak] == UNKNOWN).all() and (colors[~weak] == GOOD).all()
    condition = paint_layer(subject, "condition:indirect")
    assert "infinite" in condition.legend[0].label
    np.testing.assert_allclose(np.nanmax(condition.values), 1.0)  # log10 of 10


def test_the_plan_names_the_effects(subject: Subject):
    shown = paint_layer(subject, "plan")
    assert "lobes" in {swatch.label for swatch in shown.legend} and "shadows" in shown.note


def test_captions_fit_a_line():
    for name in LAYERS:
        assert len(layer_kind(name).caption) < 100


def test_layers_do_not_need_a_mesh_in_every_pixel(model: RelightModel):
    """A camera turned half away: most of the picture is empty, and nothing divides by it."""
    assert isinstance(model.camera, Camera)
    points = model.pixels.points
    kept = np.flatnonzero(points.pixel % WIDTH < 6)
    pixels = replace(
        model.pixels,
        points=points.take(kept),
        **{k: getattr(model.pixels, k)[kept] for k in ("surface", "albedo", "normal", "lobe_gain", "num_lit")},
    )
    part = replace(model, pixels=pixels)
    for name in layer_names(part, has_capture=False):
        assert layer(part, name).image.dtype == np.uint8


def test_photographs_under_the_same_lights_are_one(subject: Subject, capture: Capture):
    """As in the recovery, which averages them: a capture with repeats is still the model's own."""
    first = capture.split("train")[0]
    twins = [replace(first, name=name, pixels=first.pixels * scale) for name, scale in (("dim", 0.5), ("bright", 1.5))]
    others = [photograph for photograph in capture.photographs if photograph is not first]
    repeated = Subject(subject.model, replace(capture, photographs=(*twins, *others)))
    assert [p.name for p in repeated.photographs] == ["dim", *(p.name for p in subject.photographs[1:])]
    for got, wanted in zip(repeated.measured, subject.measured, strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-6)
