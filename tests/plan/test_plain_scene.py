"""Two diffuse convex objects on nothing: direct light and its shadow rays, and what else is not there costs nothing."""

import numpy as np

from relight3d.evaluate.worth import left_out
from relight3d.lights import DirectionalLight
from relight3d.relight.calibrate import frame_times_ms
from relight3d.relight.force import apply_plan
from relight3d.relight.options import RelightOptions
from relight3d.relight.plan import plan_of
from relight3d.relight.relighter import Relighter
from tests.plan.models import plain_model, rich_model

SUN = DirectionalLight((0.3, -0.4, 0.8), 3.0)
BELOW = DirectionalLight((0.1, 0.1, -1.0), 3.0)


def test_what_has_no_evidence_is_not_in_the_model() -> None:
    """No array is left of it: recovery itself leaves it out."""
    plain = plain_model()
    assert plain.indirect is None and plain.residual is None and plain.background is None
    assert not any(plain.lobes) and plain.mirrors == ()
    assert plain.pixels.normal is plain.pixels.points.normal and (plain.pixels.lobe_gain == 1).all()
    assert apply_plan(plain) is plain
    assert rich_model().indirect is not None and rich_model().residual is not None


def test_the_plan_has_direct_light_and_shadows_only() -> None:
    assert set(plan_of(plain_model()).effects) == {"shadows", "borders", "outlines"}  # the antialiasing of the two


def test_a_frame_casts_one_ray_for_each_pixel_that_faces_the_light() -> None:
    relighter = Relighter(plain_model(), options=RelightOptions(edge_samples=1))
    view = relighter.view
    for light in (SUN, BELOW):
        to_light = np.array(light.to_light, np.float32)
        facing = (view.normal @ to_light > 0) & (view.points.geometric_normal @ to_light > 0)
        rays = relighter.render([light]).stats.rays
        assert rays["shadow"] == facing.sum() and rays.get("thrown", 0) == 0
        assert rays["border"] <= 4 * facing.sum()
    assert relighter.render([]).stats.num_rays == 0


def test_the_frame_of_the_plan_is_the_frame_with_everything_forced_on_and_cheaper() -> None:
    """What the plan leaves out is not missed, and its absence is what makes the frame cheap."""
    planned = plain_model()
    forced = plain_model(force=left_out(plan_of(planned)))
    assert {"indirect", "residual", "lobes", "texture"} <= set(plan_of(forced).effects)
    cheap, dear = (Relighter(m, options=RelightOptions()) for m in (planned, forced))
    assert np.abs(cheap.render([SUN]).radiance - dear.render([SUN]).radiance).mean() < 0.002  # of about 0.2
    assert cheap.render([SUN]).stats.num_rays <= dear.render([SUN]).stats.num_rays
    pairs = np.array([(frame_times_ms(cheap, 1)[0], frame_times_ms(dear, 1)[0]) for _ in range(41)])
    # 0.7 is measured: most of so small a frame is its start. The quickest frames are those that other work left alone.
    ours, theirs = np.quantile(pairs, 0.1, axis=0)
    assert ours < 0.95 * theirs
