"""How close to the hardware a frame is: ratios to bare Embree and others, measured in one run.

    python pipelines/benchmark.py --model desk.relight --json out.json --gate tests/benchmarks/baseline.json

Everything takes turns, round by round, and medians are compared: absolute times of a shared machine mean nothing.
"""

import argparse
import json
from pathlib import Path

from bench.cases import run_case
from bench.report import gate, summary, table

from relight3d.io.capture import load_capture
from relight3d.io.model_file import load_model
from relight3d.recover.run import recover

SIZES = {"400x300": (400, 300), "1280x720": (1280, 720), "1920x1080": (1920, 1080)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, help="a model file; else the desk is recovered first")
    parser.add_argument("--capture", type=Path, default=Path("data/desk"))
    parser.add_argument("--faces", type=int, nargs="+", default=[120_732], help="also 500000 2000000")
    parser.add_argument("--sizes", nargs="+", choices=list(SIZES), default=["400x300"])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--mitsuba", type=Path, help="a Python that has Mitsuba; left out without it")
    parser.add_argument("--json", type=Path, help="where the figures go")
    parser.add_argument("--gate", type=Path, help="a baseline: fail where a ratio is 30 %% above it")
    arguments = parser.parse_args()
    model = load_model(arguments.model) if arguments.model else recover(load_capture(arguments.capture))
    cases = [
        run_case(model, faces, SIZES[size], arguments.rounds, arguments.mitsuba)
        for faces in arguments.faces
        for size in arguments.sizes
    ]
    print("\n\n".join([*(table(case) for case in cases), summary(cases)]))
    if arguments.json:
        arguments.json.write_text(json.dumps(cases, indent=1) + "\n")
    if arguments.gate:
        slower = gate(cases, json.loads(arguments.gate.read_text()))
        print("\n".join(slower) or "no ratio is 30 % above the baseline")
        raise SystemExit(1 if slower else 0)


if __name__ == "__main__":
    main()
