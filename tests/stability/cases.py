"""The one list of stability cases, which the tests and the table of docs/stability.md run."""

from tests.stability import extrapolation_cases, fit_cases, geometry_cases, image_cases, light_cases
from tests.stability.harness import CASES, Case, Outcome

GROUPS = ("geometry", "lights", "images", "fits", "extrapolation")
CASES.sort(key=lambda case: GROUPS.index(case.group))

__all__ = [
    "CASES",
    "GROUPS",
    "Case",
    "Outcome",
    "extrapolation_cases",
    "fit_cases",
    "geometry_cases",
    "image_cases",
    "light_cases",
]
