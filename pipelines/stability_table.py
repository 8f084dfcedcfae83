"""The table of hard cases in docs/stability.md, from the list of cases that the tests run.

    python pipelines/stability_table.py

Each case is run, so its physical expectation is checked again; a case that fails is shown as failed.
"""

import argparse
import sys
import time
from pathlib import Path

from stability.sections import table, write_section

HEADER = ["case", "what could break", "status returned", "error", "well-posed", "worst condition", "what is checked"]


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    sys.path.insert(0, str(Path(__file__).parents[1]))  # the list of cases is the tests' own
    from tests.stability.cases import CASES, Outcome

    rows: dict[str, list[list[str]]] = {}
    worst = (0.0, "")
    for case in CASES:
        begin = time.perf_counter()
        try:
            outcome = case.check()
        except AssertionError as failure:
            outcome = Outcome("**failed**", note=str(failure).splitlines()[0][:120] if str(failure) else "")
        worst = max(worst, (outcome.condition or 0.0, case.name))
        rows.setdefault(case.group, []).append([case.name, case.risk, *_cells(outcome)])
        print(f"{case.group}: {case.name}: {outcome.status} ({time.perf_counter() - begin:.1f} s)", flush=True)
    text = [
        "## Hard cases, one by one",
        "",
        "`python pipelines/stability_table.py`: a small synthetic desk, made worse",
    ]
    text += [
        "in one way at a time. The error is relative RMSE over held-out frames, the well-posed answer's own beside"
    ]
    text += ["it; the status is the worst one of each family of solves, and how many share it. Every case also asserts"]
    text += ["that all numbers of the model are finite, lobes within energy 1 and frames bounded.", ""]
    text += [f"Worst finite condition met: {worst[0]:.1e} ({worst[1]}).", ""]
    for group, lines in rows.items():
        text += [f"### {group.capitalize()}", "", table(HEADER, lines), ""]
    write_section("cases", "\n".join(text))


def _cells(outcome) -> list[str]:
    numbers = [
        "" if outcome.error is None else f"{outcome.error:.2g}",
        "" if outcome.wanted is None else f"{outcome.wanted:.2g}",
        "" if not outcome.condition else f"{outcome.condition:.1e}",
    ]
    return [outcome.status, *numbers, outcome.note]


if __name__ == "__main__":
    main()
