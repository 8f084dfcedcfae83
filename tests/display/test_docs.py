"""The guide and the page of layers: their pictures exist, their snippets parse, no layer is left out."""

import ast
import json
import re
from pathlib import Path

import numpy as np
import pytest

from relight3d.cli import COMMANDS
from relight3d.display.layers import LAYERS
from relight3d.io.light_files import read_lights
from relight3d.lights import light_from_dict

DOCS = Path(__file__).parents[2] / "docs"
LAYER_PAGE, GUIDE = (DOCS / name for name in ("layers.md", "guide.md"))


@pytest.mark.parametrize("page", [LAYER_PAGE, GUIDE])
def test_what_a_page_links_to_is_there(page: Path):
    links = re.findall(r"\]\(([^)#]+)\)", page.read_text("utf-8"))
    assert links and all((DOCS / link).is_file() for link in links), links


def test_every_layer_has_its_picture_and_line():
    text = LAYER_PAGE.read_text("utf-8")
    for name, kind in LAYERS.items():
        assert f"images/layers/{name}.png" in text and f"`{name}`" in text
        assert (f"`{name}` **C**" in text) == kind.needs_capture


def test_the_pictures_are_small():
    ours = [
        DOCS / "images" / "pixel.png",
        *(DOCS / "images").glob("viewer*.png"),
        *(DOCS / "images" / "layers").glob("*"),
    ]
    assert sum(path.stat().st_size for path in ours) < 3e6


@pytest.mark.parametrize("page", [LAYER_PAGE, GUIDE])
def test_snippets_parse(page: Path):
    text = page.read_text("utf-8")
    for code in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        ast.parse(code)
    for code in re.findall(r"```json\n(.*?)```", text, flags=re.DOTALL):
        frames = json.loads(code)["frames"]
        assert [light_from_dict(light).kind for frame in frames for light in frame["lights"]] == ["directional"]
    shown = re.findall(r"^relight3d (\w+)", text, flags=re.MULTILINE)
    assert set(shown) <= set(COMMANDS)


def test_the_guides_path_of_lights_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (code,) = re.findall(r"```python\n(.*?)```", GUIDE.read_text("utf-8"), flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "guide.md", "exec"), {})
    frames, is_sequence = read_lights(tmp_path / "PATH.json")
    assert is_sequence and len(frames) == 120 and all(len(lights) == 1 for lights in frames)


def test_the_guides_chrome_ball_gives_the_light():
    """The formula of the table, against the reflection that it stands for."""
    light = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    half = light + (0.0, 0.0, 1.0)  # the highlight is where the normal halves the way to the camera
    a, b, n_z = half / np.linalg.norm(half)
    np.testing.assert_allclose((2 * n_z * a, 2 * n_z * b, 2 * n_z**2 - 1), light)
