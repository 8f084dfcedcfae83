"""Is the plan right? Every effect switched the other way, and what held-out photographs say of it.

    python pipelines/plan_check.py data/desk --output output/plan

Two recoveries: one as it is, one forced to have all that the plan leaves out; both are kept until their inputs change.
"""

from dataclasses import replace
from pathlib import Path

from stages import CapturePath, Options
from start import start

import relight3d
from relight3d.commands.tables import markdown_table
from relight3d.evaluate.worth import HeldOut, Worth, left_out, worth_of_effects
from relight3d.io.files import write_text
from relight3d.io.stage_file import kept
from relight3d.progress import say, stage_bar
from relight3d.recover.run import RecoverOptions, recover
from relight3d.relight.options import RelightOptions
from relight3d.relight.plan import plan_of

CAPTURE, OUTPUT = Path("data/desk"), Path("output/plan")
OPTIONS = RecoverOptions(prices=False)
COLUMNS = ("effect", "of", "plan", "gain dB", "noise dB", "switched: frame dB", "its pixels dB", "as it should")


def main(capture: CapturePath = CAPTURE, output: Path = OUTPUT, options: Options = OPTIONS) -> None:
    read = relight3d.load_capture(capture)
    with stage_bar("recover") as report:
        model = kept(output / "model.npz", lambda: recover(read, options, progress=report), read, options)
    all_on = replace(options, force=left_out(plan_of(model)))
    with stage_bar("recover with all effects") as report:
        with_all = kept(output / "with_all.npz", lambda: recover(read, all_on, progress=report), read, all_on)
    found = worth_of_effects(model, read, with_all)
    held_out = HeldOut(read, model)
    exact = held_out.psnr_db(model, RelightOptions()).mean()
    everything = held_out.psnr_db(with_all, RelightOptions()).mean()
    lines = [f"{read.folder.name}: as planned {exact:.2f} dB, with all effects forced on {everything:.2f} dB", ""]
    text = "\n".join([*lines, ""]) + markdown_table(COLUMNS, [cells(one) for one in found])
    write_text(output / "plan_check.md", text)
    say(text)
    say(f"{sum(one.is_right for one in found)} of {len(found)} effects as they should be; {output / 'plan_check.md'}")


def cells(one: Worth) -> tuple[str, ...]:
    evidence = ["" if value is None else f"{value:.2f}" for value in (one.gain_db, one.noise_db)]
    own, state = f"{one.own_db:.2f} ± {one.scatter_db:.2f}", "on" if one.is_on else "off"
    return (one.effect, one.where, state, *evidence, f"{one.frame_db:.2f}", own, "yes" if one.is_right else "NO")


if __name__ == "__main__":
    start(main, __doc__)
