"""relight3d evaluate: the table and its JSON."""

import json
from pathlib import Path

import pytest

from tests.commands.asserts import TINY, assert_one_line


def test_evaluate_prints_the_table_with_every_baseline(run, model_file: Path) -> None:
    status, out, err = run("evaluate", model_file, TINY)
    assert (status, err) == (0, "")
    for word in ("relight3d", "ptm", "hsh2", "hsh3", "rbf", "one_light", "new_view", "worst frame", "mirror"):
        assert word in out, word


def test_evaluate_prints_json_and_nothing_else(run, model_file: Path) -> None:
    status, out, _ = run("evaluate", model_file, TINY, "--json", "--no-baselines")
    figures = json.loads(out)
    assert status == 0 and figures["baselines"] == {}
    each = [frame["psnr_db"] for frame in figures["model"]["frames"]]
    assert len(each) == 5 and figures["model"]["worst"]["psnr_db"] == min(each)
    assert figures["model"]["mean"]["psnr_db"] == pytest.approx(sum(each) / 5)
    assert figures["model"]["mean"]["psnr_db"] > 24  # 26.9, in haste; interpolation reaches 18.8


def test_evaluate_refuses_an_unknown_split(run, model_file: Path) -> None:
    status, _, err = run("evaluate", model_file, TINY, "--split", "tset")
    assert_one_line(status, err, "split", "tset", "test, train")
