"""Every script through its command line, on the tiny desk, in the order a person would run them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TINY = "data/desk_tiny"
QUICK = ["--mesh.target-faces", "2000", "--num-rounds", "1", "--num-alternations", "2"]

# script, arguments, a word it prints, files it leaves
STAGES = [
    ("prepare_mesh", [], "faces in", ["placed.npz", "mesh.npz", "mesh.ply"]),
    ("find_surfaces", [], "8 surfaces", ["surfaces.npz", "surfaces.png"]),
    ("visibility", [], "shadow rays", ["visibility.npz", "visibility/train_00.png", "visibility/lights_off.png"]),
    ("diffuse_and_indirect", [], "Albedo", ["diffuse_0.npz", "albedo.exr", "albedo.png", "indirect.png"]),
    ("lobes", [], "exponent", ["lobes_1.npz"]),
    ("detail", [], "mirror", ["detail_1.npz", "normals.png"]),
    ("residual", [], "solves: ", ["model.npz", "model.relight"]),
]


def run_script(name: str, *arguments: object) -> str:
    """What a script prints; it must end well."""
    command = [sys.executable, f"pipelines/{name}.py", *map(str, arguments)]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    ended = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all scripts, so that each finds what the ones before it kept."""
    return tmp_path_factory.mktemp("output")


@pytest.mark.parametrize(("name", "arguments", "word", "files"), STAGES, ids=[stage[0] for stage in STAGES])
def test_a_stage_says_what_it_found_and_leaves_its_files(
    output: Path, name: str, arguments: list[str], word: str, files: list[str]
) -> None:
    printed = run_script(name, TINY, "--output", output / "stages", *arguments, *QUICK)
    assert word in printed
    for file in files:
        assert (output / "stages" / file).stat().st_size > 0, file


@pytest.mark.parametrize(
    ("name", "arguments"),
    [("inspect_capture", []), ("find_surfaces", []), ("accuracy", ["--docs"]), ("degradation", ["--out"])],
)
def test_a_capture_that_is_not_there_is_one_line_and_spoils_no_page(
    tmp_path: Path, name: str, arguments: list[str]
) -> None:
    given = [tmp_path / "none", *(part for option in arguments for part in (option, tmp_path / "docs"))]
    ended = subprocess.run(
        [sys.executable, f"pipelines/{name}.py", *map(str, given)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ended.returncode == 2 and "Traceback" not in ended.stderr, ended.stderr
    assert str(tmp_path / "none") in ended.stderr.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_a_capture_is_inspected() -> None:
    printed = run_script("inspect_capture", TINY)
    assert "train_00" in printed and "lights_off" in printed and "64 x 48" in printed


def test_an_inspected_capture_that_its_photographs_contradict_is_refused(tmp_path: Path) -> None:
    top = json.loads((ROOT / TINY / "transforms.json").read_text())
    for frame in top["frames"]:
        frame["file_path"] = str(ROOT / TINY / frame["file_path"])
        frame["lights"] = [light | {"to_light": [-x for x in light["to_light"]]} for light in frame["lights"]]
    top["mesh_path"] = str(ROOT / TINY / top["mesh_path"])
    (tmp_path / "transforms.json").write_text(json.dumps(top))
    command = [sys.executable, "pipelines/inspect_capture.py", str(tmp_path)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 2 and "train_00" in ended.stdout, ended.stderr
    assert "negate it" in ended.stderr.splitlines()[-1]


def test_a_capture_is_recovered_evaluated_and_relit(output: Path) -> None:
    printed = run_script("recover_and_evaluate", TINY, "--output", output / "whole", *QUICK)
    assert "relight3d" in printed and "rbf" in printed
    for file in ("model.relight", "evaluation.md", "evaluation.json", "contact_sheet.png"):
        assert (output / "whole" / file).stat().st_size > 0, file
    film = output / "whole" / "round"
    printed = run_script("relight_sequence", output / "whole/model.relight", "--output", film, "--num-frames", 3)
    assert "3 frames rendered" in printed and (film / "film.mp4").is_file()
    assert len(list((film / "frames").glob("*.png"))) == 3
    printed = run_script("equality", "--capture", TINY, "--model", output / "whole/model.relight")
    assert "18 photographs: at most" in printed


def test_the_plan_is_checked_effect_by_effect(output: Path) -> None:
    printed = run_script("plan_check", TINY, "--output", output / "check", *QUICK)
    assert "effects as they should be" in printed and "| shadows | scene | on |" in printed
    assert (output / "check" / "plan_check.md").is_file()


def test_budgets_are_kept_or_said_to_be_missed(output: Path) -> None:
    printed = run_script("budgets", TINY, "--output", output / "budgets", "--budgets", "0.01", "64", *QUICK)
    assert "no setting fits the budget of 0.01 ms" in printed and (output / "budgets" / "budgets.md").is_file()


def test_the_stages_make_the_model_that_recover_makes(output: Path) -> None:
    # The scripts spell out the order that recover/run.py holds; this is what keeps the two together.
    code = (
        "import sys; sys.path.insert(0, 'pipelines')\n"
        "import dataclasses, pathlib, relight3d, stages\n"
        "from relight3d.io.files import hash_of\n"
        "quick = relight3d.RecoverOptions(num_rounds=4, max_error_db=1.0, num_alternations=2, prices=False)\n"
        "quick = dataclasses.replace(quick, mesh=dataclasses.replace(quick.mesh, target_faces=2000))\n"
        f"model = stages.Stages(pathlib.Path('{TINY}'), pathlib.Path('{output / 'stages'}'), quick).model\n"
        f"assert hash_of(model) == hash_of(relight3d.recover(relight3d.load_capture('{TINY}'), quick, quiet=True))\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 0, ended.stderr
