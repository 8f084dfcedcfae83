"""Recovery as a user runs it: the stages of relight3d.recover in their order, then the price list of the model's frames.

It stands above both halves: recovery knows nothing of frames, and the prices are measured on frames.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import replace

from relight3d.progress import Report, stage_bar
from relight3d.records import Capture, RelightModel
from relight3d.recover import run
from relight3d.recover.run import RecoverOptions
from relight3d.relight.prices import measure_prices

log = logging.getLogger("relight3d")
STAGES_SHARE = 0.9  # of the progress bar; the prices have the rest


def recover(
    capture: Capture,
    options: RecoverOptions | None = None,
    quiet: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> RelightModel:
    """Recover a scene from a capture: mesh, photographs and lights in, a RelightModel with its price list out.

    Shows a progress bar (lines where there is no terminal) unless `quiet`, or calls `progress(stage, fraction)` instead.
    Deterministic: the same capture and options give the same model whatever the machine and the number of threads, unless
    a time budget is set. Raises InputError for a capture that cannot be recovered: no training photograph, a mesh that
    the camera misses, no valid pixel on it.
    """
    options = options or RecoverOptions()
    if progress is not None:
        return _recover(capture, options, progress)
    with stage_bar("recover", quiet) as report:
        return _recover(capture, options, report)


def _recover(capture: Capture, options: RecoverOptions, report: Report) -> RelightModel:
    share = STAGES_SHARE if options.prices else 1.0
    model = run.recover(capture, options, progress=lambda stage, fraction: report(stage, share * fraction))
    if not options.prices:
        return model
    if options.budget_s is not None and sum(model.seconds.values()) * (1 + run.PRICES_SHARE) > options.budget_s:
        given_up = run.given_up(options.budget_s, ["the price list: time and error budgets go by the general presets"])
        return replace(model, warnings=(*model.warnings, *given_up))
    report("prices", share)
    start = time.perf_counter()
    prices = measure_prices(model, capture)
    seconds = time.perf_counter() - start
    log.info("prices: %d settings, %.2f s", len(prices), seconds)
    report("prices", 1.0)
    return replace(model, prices=prices, seconds={**model.seconds, "prices": seconds})
