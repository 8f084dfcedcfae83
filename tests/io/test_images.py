"""Every format, depth and channel count comes back as linear radiance; every damage is one line."""

from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import PIL.Image
import pytest
import tifffile

from relight3d.errors import InputError
from relight3d.io.images import image_size, read_image, read_mask, write_exr, write_png
from relight3d.maths.color import linear_from_srgb

HEIGHT, WIDTH = 5, 7


@pytest.fixture
def unit_rgb() -> np.ndarray:
    """Values in [0, 1], both ends included."""
    rgb = np.random.default_rng(0).random((HEIGHT, WIDTH, 3), dtype=np.float32)
    rgb[0, 0], rgb[0, 1] = 0.0, 1.0
    return rgb


def as_integers(rgb: np.ndarray, dtype: type) -> np.ndarray:
    return np.rint(rgb.astype(np.float64) * np.iinfo(dtype).max).astype(dtype)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_integers_are_divided_by_their_largest(tmp_path: Path, unit_rgb, dtype, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    stored = as_integers(unit_rgb, dtype)
    write_png(path, stored) if suffix == "png" else tifffile.imwrite(path, stored, photometric="rgb")
    radiance, is_valid = read_image(path)
    assert radiance.dtype == np.float32 and is_valid is None
    # One float32 division: half a unit in the last place of 1. Eight bits lost would be 2e-3.
    np.testing.assert_allclose(radiance, stored / np.iinfo(dtype).max, atol=1e-7)
    assert image_size(path) == (WIDTH, HEIGHT)


def test_srgb_is_decoded(tmp_path: Path, unit_rgb) -> None:
    stored = as_integers(unit_rgb, np.uint8)
    write_png(tmp_path / "a.png", stored)
    radiance, _ = read_image(tmp_path / "a.png", "srgb")
    np.testing.assert_allclose(radiance, linear_from_srgb(stored.astype(np.float32) / 255), atol=1e-7)


def test_jpeg_in_colour_and_grey(tmp_path: Path) -> None:
    PIL.Image.new("RGB", (WIDTH, HEIGHT), (200, 100, 50)).save(tmp_path / "a.jpg", quality=95)
    radiance, _ = read_image(tmp_path / "a.jpg", "srgb")
    assert image_size(tmp_path / "a.jpg") == (WIDTH, HEIGHT)
    # A flat colour survives JPEG to its rounding, 2 codes of 255; the curve's slope is below 2.3.
    np.testing.assert_allclose(radiance[2, 3], linear_from_srgb(np.array([200, 100, 50]) / 255), atol=2 * 2.3 / 255)
    PIL.Image.new("L", (WIDTH, HEIGHT), 128).save(tmp_path / "g.jpg")
    assert read_image(tmp_path / "g.jpg")[0].shape == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize("half", [False, True])
def test_exr_keeps_negative_and_bright_values(tmp_path: Path, half: bool) -> None:
    rgb = np.random.default_rng(1).normal(0.0, 50.0, (HEIGHT, WIDTH, 3)).astype(np.float32)
    write_exr(tmp_path / "a.exr", rgb, half=half)
    radiance, is_valid = read_image(tmp_path / "a.exr")
    assert is_valid is None and image_size(tmp_path / "a.exr") == (WIDTH, HEIGHT)
    np.testing.assert_allclose(radiance, rgb, rtol=2**-11 if half else 0)  # half a unit of half's eleven bits


def test_half_holds_what_it_cannot_at_its_largest(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", np.full((2, 2, 3), 1e6, np.float32), half=True)
    assert (read_image(tmp_path / "a.exr")[0] == 65504).all()


def test_float_tiff_and_grey_exr(tmp_path: Path, unit_rgb) -> None:
    tifffile.imwrite(tmp_path / "a.tif", unit_rgb * 7 - 1, photometric="rgb")
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif")[0], unit_rgb * 7 - 1)
    write_exr(tmp_path / "y.exr", unit_rgb[..., 0])
    np.testing.assert_array_equal(read_image(tmp_path / "y.exr")[0], np.repeat(unit_rgb[..., :1], 3, axis=2))


@pytest.mark.parametrize("compression", [None, "lzw", "zlib"])
@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_tiff_packings(tmp_path: Path, unit_rgb, compression: str | None, planar: str) -> None:
    stored = as_integers(unit_rgb, np.uint16)
    planes = stored if planar == "contig" else np.moveaxis(stored, -1, 0)
    options = {"compression": compression, "planarconfig": planar, "photometric": "rgb"}
    tifffile.imwrite(tmp_path / "a.tif", planes, **options)
    np.testing.assert_allclose(read_image(tmp_path / "a.tif")[0], stored / 65535, atol=1e-7)
    assert image_size(tmp_path / "a.tif") == (WIDTH, HEIGHT)


def with_alpha(rgb: np.ndarray) -> np.ndarray:
    alpha = np.ones((*rgb.shape[:2], 1), rgb.dtype)
    alpha[1, 2] = 0
    return np.concatenate([rgb, alpha], axis=2)


@pytest.mark.parametrize("suffix", ["png", "tif", "exr"])
def test_alpha_zero_is_invalid(tmp_path: Path, unit_rgb, suffix: str) -> None:
    path, rgba = tmp_path / f"a.{suffix}", with_alpha(unit_rgb)
    if suffix == "png":
        write_png(path, as_integers(rgba, np.uint16))
    elif suffix == "tif":
        tifffile.imwrite(path, as_integers(rgba, np.uint16), photometric="rgb", extrasamples=["unassalpha"])
    else:
        OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGBA": rgba}).write(str(path))
    radiance, is_valid = read_image(path)
    assert is_valid is not None and not is_valid[1, 2] and is_valid.sum() == HEIGHT * WIDTH - 1
    assert (radiance[1, 2] == 0).all()


def test_an_extra_tiff_channel_that_is_not_alpha_hides_nothing(tmp_path: Path, unit_rgb) -> None:
    rgba = as_integers(with_alpha(unit_rgb), np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", rgba, photometric="rgb", extrasamples=["unspecified"])
    assert read_image(tmp_path / "a.tif")[1] is None


def test_nan_and_infinity_are_invalid_and_noise_below_zero_is_not(tmp_path: Path, unit_rgb) -> None:
    unit_rgb[0, 0, 1], unit_rgb[0, 1, 2], unit_rgb[0, 2, 0] = np.nan, np.inf, -0.25
    write_exr(tmp_path / "a.exr", unit_rgb)
    radiance, is_valid = read_image(tmp_path / "a.exr")
    assert is_valid is not None and list(is_valid[0, :3]) == [False, False, True]
    assert np.isfinite(radiance).all() and radiance[0, 2, 0] == np.float32(-0.25)


def test_masks_of_every_kind(tmp_path: Path) -> None:
    wanted = np.zeros((HEIGHT, WIDTH), dtype=bool)
    wanted[1:4, 2:5] = True
    grey = wanted.astype(np.uint8)  # 1, not 255: anything above zero counts
    write_png(tmp_path / "grey.png", grey)
    write_png(tmp_path / "rgba.png", np.dstack([grey * 0 + 9] * 3 + [grey]))
    PIL.Image.fromarray(grey * 255).convert("1").save(tmp_path / "bit.png")
    for name in ("grey.png", "rgba.png", "bit.png"):
        np.testing.assert_array_equal(read_mask(tmp_path / name), wanted)
    big = np.kron(wanted, np.ones((16, 16), dtype=bool))
    PIL.Image.fromarray(big.astype(np.uint8) * 255).save(tmp_path / "a.jpg", quality=60)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.jpg"), big)  # JPEG rings there; the threshold is half way


@pytest.mark.parametrize("suffix", ["png", "tif", "exr", "jpg"])
def test_a_cut_file_is_one_line(tmp_path: Path, unit_rgb, suffix: str, capfd: pytest.CaptureFixture) -> None:
    path = tmp_path / f"a.{suffix}"
    large = np.kron(unit_rgb, np.ones((8, 8, 1), np.float32))
    if suffix == "exr":
        write_exr(path, large)
    elif suffix == "tif":
        tifffile.imwrite(path, large, photometric="rgb")
    else:
        PIL.Image.fromarray(as_integers(large, np.uint8)).save(path)
    whole = path.read_bytes()
    for length in (0, 1, 3, 5, 30, 200, len(whole) // 2, len(whole) - 40):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError) as caught:
            read_image(path)
        assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")  # OpenEXR and tifffile would complain on the terminal too


def test_what_is_no_photograph_says_so(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("not an image at all")
    for path, words in ((tmp_path / "a.png", "EXR, PNG, TIFF or JPEG"), (tmp_path / "none.png", "No such file")):
        for read in (read_image, read_mask, image_size):
            with pytest.raises(InputError, match=words):
                read(path)
    tifffile.imwrite(tmp_path / "i.tif", np.zeros((4, 4), np.int16))
    with pytest.raises(InputError, match="int16"):
        read_image(tmp_path / "i.tif")
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Z": np.zeros((4, 4), np.float32)}).write(str(tmp_path / "z.exr"))
    with pytest.raises(InputError, match="the channels Z"):
        read_image(tmp_path / "z.exr")
    write_png(tmp_path / "ok.png", np.zeros((4, 4), np.uint8))
    with pytest.raises(InputError, match="color_space"):
        read_image(tmp_path / "ok.png", "rec709")


def test_png_is_written_as_others_read_it(tmp_path: Path, unit_rgb) -> None:
    stored = as_integers(unit_rgb, np.uint8)
    write_png(tmp_path / "a.png", stored)
    np.testing.assert_array_equal(np.asarray(PIL.Image.open(tmp_path / "a.png")), stored)
    deep = as_integers(unit_rgb, np.uint16)
    write_png(tmp_path / "b.png", deep)
    np.testing.assert_array_equal(imagecodecs.png_decode((tmp_path / "b.png").read_bytes()), deep)
