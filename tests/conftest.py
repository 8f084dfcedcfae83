"""What all tests share: jaxtyping's shape checks (see addopts in pyproject.toml) and numba live together."""

import functools
import inspect

import numba


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
