"""The pictures of docs/images that show the display: photographs, relit frames, layers, a looked-at pixel, the viewer.

    python pipelines/make_figures.py data/desk --output docs/images

The model is kept between runs. The viewer's pictures need Xvfb and Vulkan, the study's plots a study; without, the old
ones stay.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from stages import CapturePath
from start import start
from virtual_screen import HAS_XVFB, XScreen

import relight3d
from relight3d.commands.contact_sheet import contact_sheet, strips
from relight3d.display.layers import LAYERS, paint_layer
from relight3d.display.pixel_figure import pixels_of
from relight3d.display.pixel_report import inspect_subject
from relight3d.display.probe import vulkan_trouble
from relight3d.display.subject import Subject
from relight3d.evaluate.disturb import with_misplaced_mesh
from relight3d.io.capture import read_photograph
from relight3d.io.stage_file import kept
from relight3d.maths.color import srgb_from_linear
from relight3d.progress import say
from relight3d.records import Capture
from relight3d.recover.registration import RegistrationOptions
from relight3d.recover.run import RecoverOptions

STUDY_PLOTS = ("error_frame.svg", "error_recovery.svg", "growth.svg")
CAPTURE, OUTPUT, WORK, STUDY = Path("data/desk"), Path("docs/images"), Path("output/desk"), Path("output/study")
FITS = ("status:indirect", "rank:indirect", "condition:indirect")
PIXEL = (0.73, 0.82)  # looked at: a place in the picture, as parts of its width and height
OFF_PX = (1.0, 0.5)  # right and down: of the picture about registration
DPI = 80  # of the layers' figures: small files


def main(capture: CapturePath = CAPTURE, output: Path = OUTPUT, work: Path = WORK, study: Path = STUDY) -> None:
    read, options = relight3d.load_capture(capture), RecoverOptions()
    model = kept(work / "model.npz", lambda: relight3d.recover(read, options), read, options)
    model.save(work / "model.relight")
    subject = Subject(model, read)
    lights = read.split("test")[0].lights  # that no photograph of the recovery has
    for name in (*LAYERS, *FITS):
        figure = paint_layer(subject, name, lights).figure()
        figure.set_dpi(DPI)
        save(output / "layers" / f"{name.replace(':', '_')}.png", pixels_of(figure))
    x, y = (int(part * size) for part, size in zip(PIXEL, (model.camera.width, model.camera.height)))
    save(output / "pixel.png", pixels_of(inspect_subject(subject, x, y).figure()))
    evaluation = relight3d.evaluate(model, read)
    save(output / "contact_sheet.png", contact_sheet(read.folder.name, strips(model, read, evaluation)))
    save(output / "registration.png", misplaced_and_placed(read))
    for name in STUDY_PLOTS:
        if (study / "plots" / name).is_file():
            (output / f"study_{name}").write_bytes((study / "plots" / name).read_bytes())
    if HAS_XVFB and not vulkan_trouble()[0]:
        shoot_viewer(work / "model.relight", capture, output)
    total = sum(path.stat().st_size for path in output.rglob("*.png"))
    say(f"{output}: {total / 1e6:.1f} MB of pictures")


def misplaced_and_placed(capture: Capture) -> np.ndarray:
    """A held-out photograph relit, and four times the difference: the mesh beside its place, and moved back (below)."""
    off = with_misplaced_mesh(capture, *OFF_PX)
    photograph = capture.split("test")[0]
    taken, _ = read_photograph(capture, photograph)
    rows = []
    for method in ("off", "auto"):
        options = RecoverOptions(prices=False, registration=RegistrationOptions(method=method))
        frame = relight3d.Relighter(relight3d.recover(off, options)).render(list(photograph.lights))
        relit, wanted = (srgb_from_linear(x * np.float32(frame.exposure)) for x in (frame.radiance, taken))
        difference = np.where(frame.is_hit[..., None], np.clip(0.5 + 4 * (relit - wanted), 0, 1), 0.5)
        rows.append(np.concatenate([relit, difference], axis=1))
    return (255 * np.concatenate(rows)).round().astype(np.uint8)


def save(path: Path, pixels: np.ndarray) -> None:
    """A PNG with a palette, dithered where that is short of colours: half the size of one without."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = Image.fromarray(pixels)
    palette = image.quantize(256)
    image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)


def shoot_viewer(model: Path, capture: Path, output: Path) -> None:
    """The viewer's window, photographed in a process of its own on a virtual screen."""
    with tempfile.TemporaryDirectory() as folder, XScreen(Path(folder), "1280x800x24") as screen:
        script = [sys.executable, str(Path(__file__).with_name("shoot_viewer.py"))]
        arguments = [str(model), str(capture), str(screen.framebuffer), folder]
        subprocess.run(
            [*script, *arguments], check=True, env=os.environ | {"DISPLAY": screen.display}, stdout=subprocess.DEVNULL
        )
        for path in Path(folder).glob("*.png"):
            with Image.open(path) as image:
                save(output / path.name, np.asarray(image))


if __name__ == "__main__":
    start(main, __doc__)
