"""Stage 7, the last: the surroundings seen in mirrors and the interpolated misfit; leaves the finished model.

    python pipelines/residual.py data/desk --output output/stages/desk
"""

from pathlib import Path

from stages import CapturePath, Options, Stages
from start import start

from relight3d.commands.recover import health_line
from relight3d.progress import say
from relight3d.recover.run import RecoverOptions

CAPTURE, OUTPUT = Path("data/desk"), Path("output/stages/desk")
OPTIONS = RecoverOptions()


def main(capture: CapturePath = CAPTURE, output: Path = OUTPUT, options: Options = OPTIONS) -> None:
    model = Stages(capture, output, options).model
    model.save(output / "model.relight")
    for decision in model.decisions:
        if decision.effect == "residual":
            say(f"residual {'on' if decision.is_on else 'off'}: {decision.gain_db:.2f} dB ({decision.reason})")
    say(f"surroundings: {0 if model.background is None else len(model.background.pixel)} pixels of mirrors show them")
    say(f"solves: {health_line(model)}")
    say(f"{output / 'model.relight'}")


if __name__ == "__main__":
    start(main, __doc__)
