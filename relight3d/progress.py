"""What a person sees while something long runs: a bar on a terminal, a line a stage elsewhere; and the log."""

import logging
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Literal, TypeVar

from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

Item = TypeVar("Item")
Report = Callable[[str, float], None]  # a stage that begins or ends, and the fraction of the whole done so far


def say(line: str) -> None:
    """A line of results, on standard output."""
    _console("stdout").print(line, soft_wrap=True)


def show(table: RenderableType) -> None:
    """A table of results, on standard output."""
    _console("stdout").print(table)


def remark(line: str) -> None:
    """A line about the run, on standard error."""
    _console("stderr").print(line, soft_wrap=True)


@contextmanager
def shown_log(verbose: bool) -> Iterator[None]:
    """Shows the library's log on standard error: each stage with its seconds if `verbose`, otherwise warnings alone."""
    logger, handler = logging.getLogger("relight3d"), logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    level, propagate = logger.level, logger.propagate
    logger.addHandler(handler)
    logger.setLevel(logging.INFO if verbose else logging.WARNING)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        logger.propagate = propagate


@contextmanager
def stage_bar(title: str, quiet: bool = False) -> Iterator[Report]:
    """Gives `report(stage, fraction)` to a run of stages, and shows it: as a bar, or as lines where no terminal is."""
    console = _console("stderr")
    if quiet:
        yield lambda stage, fraction: None
    elif not console.is_terminal:
        yield _line_reporter(title)
    else:
        columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
        with Progress(*columns, TimeElapsedColumn(), console=console, transient=True) as bar:
            task = bar.add_task(title, total=1.0)

            def report(stage: str, fraction: float) -> None:
                bar.update(task, completed=min(max(fraction, 0.0), 1.0), description=f"{title}: {stage}")

            yield report


def track(items: Iterable[Item], title: str, total: int, quiet: bool = False) -> Iterator[Item]:
    """The items one by one, with a bar that counts them; where no terminal is, a line for each tenth of them."""
    console = _console("stderr")
    if quiet:
        yield from items
    elif not console.is_terminal:
        report, step = _line_reporter(title), max(1, -(-total // 10))
        for count, item in enumerate(items, start=1):
            yield item
            if count % step == 0 or count == total:
                report(f"{count} of {total}", count / total)
    else:
        columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as bar:
            yield from bar.track(items, total=total, description=title)


@contextmanager
def working(title: str, quiet: bool = False) -> Iterator[None]:
    """A spinner for work whose length is not known; nothing where no terminal is."""
    console = _console("stderr")
    if quiet or not console.is_terminal:
        yield
    else:
        with console.status(title):
            yield


def _line_reporter(title: str) -> Report:
    started, last = time.perf_counter(), ""

    def report(stage: str, fraction: float) -> None:
        nonlocal last
        if stage == last and fraction < 1.0:
            return  # its end; the line came as it began
        seconds, last = time.perf_counter() - started, stage
        remark(f"{title}: {seconds:6.1f} s {100 * min(max(fraction, 0.0), 1.0):4.0f} %  {stage}")

    return report


def _console(name: Literal["stdout", "stderr"]) -> Console:
    stream = getattr(sys, name)
    # Tables need room in a pipe or file, which say nothing of their width.
    return Console(file=stream, width=None if stream.isatty() else 140, highlight=False, markup=False, emoji=False)
