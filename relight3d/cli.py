"""The command line: one subcommand a name of the library. Exit 0 done, 2 bad input, 130 stopped by Ctrl-C."""

import io
import signal
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr
from difflib import get_close_matches
from importlib import import_module

from relight3d.errors import InputError
from relight3d.progress import say

# Each is a class in a module of relight3d.commands, imported when it is asked for; the line is for the overview.
COMMANDS = {
    "demo": ("demo.Demo", "recover, evaluate and relight the desk that comes with the repository"),
    "recover": ("recover.Recover", "recover a model from a capture"),
    "render": ("render.Render", "relight a model: a picture, numbered frames or a film"),
    "evaluate": ("evaluate.Evaluate", "compare a model with photographs it has not seen"),
    "plan": ("plan.Plan", "show which effects a model has on which surface, and the evidence"),
    "study": ("study.Study", "measure what accuracy costs in time"),
    "view": ("view.View", "move the lights and the camera in a window"),
    "report": ("report.Report", "write a page about a model and its capture"),
    "import": ("import_capture.Import", "make a capture of a mesh, cameras, lights and images of other programs"),
}
DONE, BAD_INPUT, INTERRUPTED, TERMINATED = 0, 2, 130, 143


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status. Bad input ends in one line on standard error, not in a traceback."""
    if arguments is None:
        arguments = sys.argv[1:]
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(TERMINATED))  # so that temporary files are removed
    try:
        return _run(list(arguments))
    except InputError as error:
        return _fail(str(error), BAD_INPUT)
    except KeyboardInterrupt:
        return _fail("stopped", INTERRUPTED)
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        return _fail(f"{place}{error.strerror or error}", BAD_INPUT)
    except SystemExit as stop:  # how tyro ends for --help and for arguments it cannot read
        return stop.code if isinstance(stop.code, int) else DONE


def _run(arguments: list[str]) -> int:
    name, rest = (arguments[0], arguments[1:]) if arguments else ("--help", [])
    if name in ("-h", "--help"):
        say(_overview())
    elif name == "--version":
        from relight3d import __version__

        say(f"relight3d {__version__}")
    elif name in COMMANDS:
        module, _, command = COMMANDS[name][0].partition(".")
        _parse(getattr(import_module(f"relight3d.commands.{module}"), command), name, rest).start()
    else:
        near = get_close_matches(name, COMMANDS, n=1)
        hint = f"perhaps {near[0]}" if near else "see relight3d --help"
        raise InputError("command", name, f"one of {', '.join(COMMANDS)}", hint)
    return DONE


def _parse(command: type, name: str, arguments: list[str]):
    """The command, with its arguments. Raises SystemExit as tyro does, and the InputError of an option's own check."""
    import tyro

    said = io.StringIO()
    try:
        with redirect_stderr(said):
            return tyro.cli(command, prog=f"relight3d {name}", args=arguments)
    except SystemExit as stop:
        cause: BaseException | None = stop
        while cause is not None and not isinstance(cause, InputError):
            cause = cause.__cause__ or cause.__context__
        if cause is not None:
            raise cause from None
        if stop.code in (None, DONE):  # --help
            raise
        _fail(f"{name}: {_in_one_line(said.getvalue())}; see relight3d {name} --help", BAD_INPUT)
        raise


def _in_one_line(box: str) -> str:
    """What tyro draws in a box, without the frame and the title, and without its way to the help."""
    lines = [line.strip("│| ") for line in box.splitlines()]
    words = [line for line in lines if line.strip("╭╮╰╯─+-") and line[0] not in "╭+"]
    return " ".join(words).partition(" For full helptext")[0]


def _overview() -> str:
    lines = [f"  {name:<10}{line}" for name, (_, line) in COMMANDS.items()]
    return "\n".join(
        ["usage: relight3d COMMAND ...", "", *lines, "", "relight3d COMMAND --help tells what a command takes."]
    )


def _fail(line: str, status: int) -> int:
    sys.stderr.write(f"relight3d: {' '.join(line.split())}\n")
    return status
