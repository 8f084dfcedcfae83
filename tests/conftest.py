"""What all tests share: jaxtyping's shape checks (see addopts in pyproject.toml) and numba live together."""

import functools
import inspect
from collections.abc import Iterator
from dataclasses import replace

import numba
import pytest


def _on_unwrapped(compile_function):
    """`numba.njit` and its kin, given the function as written instead of as wrapped by the shape checks.

    The hook wraps every function of relight3d, kernels too, and numba cannot compile the wrapper. Users run
    no hook, so this compiles exactly what they run; a kernel's own shapes go unchecked.
    """

    @functools.wraps(compile_function)
    def compile_unwrapped(*args, **options):
        if args and inspect.isfunction(args[0]):
            return compile_function(inspect.unwrap(args[0]), *args[1:], **options)
        decorate = compile_function(*args, **options)
        return lambda function: decorate(inspect.unwrap(function))

    return compile_unwrapped


for _name in ("jit", "njit", "vectorize", "guvectorize"):
    setattr(numba, _name, _on_unwrapped(getattr(numba, _name)))


@pytest.fixture(autouse=True, scope="session")
def quick_to_bake() -> Iterator[None]:
    """The preset that casts shadows ahead, with a few hundred directions: thousands take ten seconds in any picture."""
    from relight3d.relight.options import PRESETS

    given = PRESETS["baked"]
    PRESETS["baked"] = replace(given, table_directions=256)
    yield
    PRESETS["baked"] = given
