"""Gains between two squared errors."""

import numpy as np


def gain_db(before: float, after: float) -> float:
    """By how many dB a squared error fell; an error of 0 counts as one of 1e-30."""
    return float(10 * np.log10(max(before, 1e-30) / max(after, 1e-30)))
