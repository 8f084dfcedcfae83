"""Chooses Mitsuba's variant before anything else imports it: LLVM if a library that works is installed, else scalar."""

import ctypes.util
import os

GOOD_LLVM = ("19", "20")  # 14 to 16 abort with "Cannot select: fminimum"


def choose(variant: str = "auto") -> str:
    """Sets and returns the variant. The scalar one is hundreds of times slower: for the tiny scene only."""
    found = os.environ.get("DRJIT_LIBLLVM_PATH") or next(
        filter(None, (ctypes.util.find_library(f"LLVM-{v}") for v in GOOD_LLVM)), None
    )
    if variant == "auto":
        variant = "llvm_ad_rgb" if found else "scalar_rgb"
    if found:
        os.environ["DRJIT_LIBLLVM_PATH"] = found
    import mitsuba as mi

    mi.set_variant(variant)
    mi.set_log_level(mi.LogLevel.Error)
    return variant
