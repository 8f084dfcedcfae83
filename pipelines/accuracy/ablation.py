"""Each effect taken out of the frames of one model: what held-out photographs say, and what a frame saves."""

from dataclasses import replace

import numpy as np

from accuracy.frames import Shot
from accuracy.rows import Found
from relight3d.effects import RAY_EFFECTS, SCENE, SCENE_EFFECTS, SURFACE_EFFECTS, Force
from relight3d.evaluate.metrics import display_values, psnr_db
from relight3d.records import RelightModel
from relight3d.relight.calibrate import frame_pair_ms
from relight3d.relight.force import apply_plan, forced_options, has_effect
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter

NUM_PAIRS = 75  # frames with and without the effect, rendered in turn


def ablation(model: RelightModel, shots: list[Shot], exposure: float, num_pairs: int = NUM_PAIRS) -> list[Found]:
    """A line for each effect that the model or its frames have."""
    exact, found = RelightOptions(), []
    before, rays = _score(model, exact, shots, exposure)
    standard = Relighter(model, options=exact)
    for effect in (*RAY_EFFECTS, *SCENE_EFFECTS, *SURFACE_EFFECTS):
        less, options = without(model, exact, effect)
        if less is model and options is exact:
            continue
        after, left = _score(less, options, shots, exposure)
        if effect in RAY_EFFECTS and left == rays and np.array_equal(after, before):
            continue  # no light of these has an extent, no mirror shows another
        full_ms, less_ms = frame_pair_ms(standard, Relighter(less, options=options), num_pairs)
        scatter = float((before - after).std(ddof=1) / len(before) ** 0.5) if len(before) > 1 else 0.0
        found.append(
            {
                "effect": effect,
                "db": float((before - after).mean()),
                "scatter": scatter,
                "full_ms": full_ms,
                "less_ms": less_ms,
                "rays": rays,
                "rays_saved": rays - left,
            }
        )
    return found


def without(model: RelightModel, options: RelightOptions, effect: str) -> tuple[RelightModel, RelightOptions]:
    """The model and the options without one effect; the very same ones where neither has it."""
    if effect in RAY_EFFECTS:
        return model, forced_options(options, {(effect, SCENE): False})
    where = [SCENE] if effect in SCENE_EFFECTS else range(model.surfaces.num_surfaces)
    force: Force = {(effect, s): False for s in where if has_effect(model, effect, s)}
    return (apply_plan(model, force) if force else model), options


def _score(model: RelightModel, options: RelightOptions, shots: list[Shot], exposure: float) -> tuple[np.ndarray, int]:
    """PSNR of each shot, and the mean number of rays of a frame under lights that no frame before had."""
    relighter, figures, rays = Relighter(model, options=replace(options)), [], []
    for shot in shots:
        frame = relighter.render(list(shot.lights))
        got, wanted = (display_values(image[shot.mask], exposure) for image in (frame.radiance, shot.wanted))
        figures.append(psnr_db(got, wanted))
        rays.append(frame.stats.num_rays)
    return np.array(figures), round(float(np.mean(rays)))
