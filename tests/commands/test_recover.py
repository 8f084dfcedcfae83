"""relight3d recover: what it writes and says."""

from pathlib import Path

import pytest

from tests.commands.asserts import QUICK, TINY, assert_one_line


def test_recover_tells_its_stages_and_counts_its_solves(run, tmp_path: Path) -> None:
    path = tmp_path / "new folder" / "tiny.relight"
    status, out, err = run("recover", TINY, "-o", path, *QUICK)
    assert status == 0 and path.is_file() and "solves: " in out and " ok" in out and "13 photographs" in out
    assert "recover: " in err and " mesh\n" in err and " 100 %" in err
    assert [p.name for p in path.parent.iterdir()] == ["tiny.relight"]


def test_verbose_logs_each_stage(run, tmp_path: Path) -> None:
    status, _, err = run("recover", TINY, "-o", tmp_path / "tiny.relight", "-v", *QUICK)
    assert status == 0 and " mesh" in err and " s\n" in err


@pytest.mark.parametrize("output", ["", "transforms.json/model.relight"])
def test_a_hopeless_output_is_refused_before_the_work(run, tiny_copy: Path, output: str) -> None:
    status, _, err = run("recover", TINY, "-o", tiny_copy / output)
    assert_one_line(status, err, str(tiny_copy / output))
