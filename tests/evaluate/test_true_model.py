"""The loop closed: the true model of a synthetic scene, relit by the real renderer, gives the photographs."""

import pytest

from relight3d.evaluate.run import evaluate
from relight3d.evaluate.truth import true_model
from relight3d.relight.options import RelightOptions
from tests.scenes import desk, desk_capture

# Synthetic photographs take one ray a pixel, as no camera does: outlines and borders must be as hard in the frames.
HARD = RelightOptions(edge_samples=1, borders=False)


@pytest.mark.parametrize("distance", [None, 3.0])
def test_without_interreflections_every_frame_is_the_photograph(distance: float | None):
    capture = desk_capture(num_lights=4, glossy=True, ambient=0.2, bounce=False, distance=distance)
    result = evaluate(true_model(desk(glossy=True, ambient=0.2)), capture, relighter_options=HARD, baselines=False)
    # 60 dB is a quarter of an 8-bit step; one shadow pixel that differs would cost 20 dB. The other viewpoint too.
    assert result.model.worst.psnr_db > 60.0


def test_interreflections_are_what_the_true_model_lacks():
    plain, bounced = (desk_capture(num_lights=4, bounce=bounce) for bounce in (False, True))
    model = true_model(desk())
    with_bounces = evaluate(model, bounced, relighter_options=HARD, baselines=False).model.mean
    without = evaluate(model, plain, relighter_options=HARD, baselines=False).model.mean
    assert with_bounces.psnr_db < 50.0 < without.psnr_db
