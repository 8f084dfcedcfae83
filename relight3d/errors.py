"""The one exception family for bad input: what was wrong, where, and what to do about it."""


class InputError(ValueError):
    """Bad input from outside: a file, an array or an option.

    Reads as one line, ``field: got ..., expected ...; what to do``. The command line prints it and
    exits with 2; a bug of our own is an ``assert`` instead and never this.
    """

    def __init__(self, field: str, got: object, expected: str, hint: str = "") -> None:
        self.field, self.got, self.expected, self.hint = field, got, expected, hint
        line = f"{field}: got {_one_line(got)}, expected {expected}"
        super().__init__(line + (f"; {hint}" if hint else ""))


class MeshError(InputError):
    """A mesh that cannot be read, or has no face left once it is cleaned."""


class ModelFileError(InputError):
    """A model file that is cut short, foreign, or of another version."""


class DisplayError(InputError):
    """No window or no offscreen renderer can be opened here."""


def _one_line(got: object, limit: int = 160) -> str:
    text = " ".join(str(got).split())
    return text if len(text) <= limit else text[: limit - 1] + "…"
