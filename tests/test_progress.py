"""What a person sees: a bar on a terminal, lines elsewhere, and nothing when quiet."""

import io
import logging

import pytest

from relight3d.progress import remark, say, shown_log, stage_bar, track, working


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Standard error becomes a terminal; called in the test itself, for pytest sets its own when a test begins."""
    stream = Terminal()
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    return stream


def test_stages_are_lines_where_no_terminal_is(capsys: pytest.CaptureFixture[str]) -> None:
    with stage_bar("recover") as report:
        for stage, fraction in [("mesh", 0.0), ("mesh", 0.5), ("lobes", 0.5), ("lobes", 1.0)]:
            report(stage, fraction)
    out, err = capsys.readouterr()
    lines = err.splitlines()
    assert out == "" and len(lines) == 3  # each stage as it begins, and the end
    assert lines[0].endswith("0 %  mesh") and lines[2].endswith("100 %  lobes")


def test_stages_are_a_bar_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = terminal(monkeypatch)
    with stage_bar("recover") as report:
        report("mesh", 0.4)
    shown = stream.getvalue()
    assert "recover: mesh" in shown and "40%" in shown and "\x1b[2K" in shown  # and it is wiped at the end


def test_items_are_counted_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = terminal(monkeypatch)
    assert list(track(range(30), "render", 30)) == list(range(30))
    assert "30/30" in stream.getvalue()


def test_items_are_a_line_for_each_tenth_elsewhere(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(track("abcdefghijklmnopqrstuvwxyz", "render", 26)) == list("abcdefghijklmnopqrstuvwxyz")
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 9 and lines[-1].endswith("26 of 26")


def test_quiet_is_silent(capsys: pytest.CaptureFixture[str]) -> None:
    with stage_bar("recover", quiet=True) as report, working("evaluate", quiet=True):
        report("mesh", 0.5)
        assert list(track([1, 2], "render", 2, quiet=True)) == [1, 2]
    assert capsys.readouterr() == ("", "")


def test_results_and_remarks_go_their_own_ways_unbroken(capsys: pytest.CaptureFixture[str]) -> None:
    say("[red] :gem: " + "long " * 60)  # brackets are no markup, names between colons no pictures, a line is a line
    remark("a remark")
    out, err = capsys.readouterr()
    assert out.count("\n") == 1 and out.startswith("[red] :gem: long") and err == "a remark\n"


def test_the_log_is_shown_while_it_is_wanted_and_no_longer(capsys: pytest.CaptureFixture[str]) -> None:
    logger = logging.getLogger("relight3d.test")
    for is_verbose in (False, True):
        with shown_log(is_verbose):
            logger.info("a stage")
            logger.warning("a warning")
    logging.getLogger("relight3d").info("afterwards")
    err = capsys.readouterr().err
    assert err.count("a stage") == 1 and err.count("a warning") == 2 and "afterwards" not in err
