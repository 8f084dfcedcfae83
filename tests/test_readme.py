"""What the README shows works: its Python runs, its commands parse, its links lead somewhere."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from relight3d.cli import COMMANDS
from relight3d.lights import light_from_dict

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text("utf-8")


def blocks(language: str) -> list[str]:
    """The README's code of one language."""
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.slow
def test_the_python_runs(tmp_path: Path) -> None:
    (code,) = blocks("python")
    code = code.replace("data/desk", str(ROOT / "data" / "desk_tiny"))
    ended = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "desk.relight").is_file()


def test_the_lights_are_lights() -> None:
    (code,) = blocks("json")
    assert [light_from_dict(entry).kind for entry in json.loads(code)] == ["directional", "point"]


def test_the_commands_exist() -> None:
    shown = re.findall(r"^relight3d (\w+)", README, flags=re.MULTILINE)
    assert shown and set(shown) <= set(COMMANDS)


def test_the_links_lead_somewhere() -> None:
    targets = [t for t in re.findall(r"\]\(([^)]+)\)", README) if "://" not in t]
    assert targets and all((ROOT / target).exists() for target in targets)
