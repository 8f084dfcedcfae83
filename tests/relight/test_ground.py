"""The plane that things stand on."""

import numpy as np
import pytest

from relight3d.evaluate.shapes import box, joined, transformed, turn_about
from relight3d.recover.mesh import MeshOptions, prepare_mesh
from relight3d.relight.ground import ground_of


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_of_a_slab_s_two_sides_it_is_the_one_with_things_on_it(turn: float) -> None:
    """Both are as large; which one rounding favours must not matter."""
    slab, thing = box(2.0, 1.6, 0.1), transformed(box(0.2, 0.2, 0.3), translation=(0.3, 0.1, 0.1))
    over = turn_about("x", 0.0 if turn > 0 else 180.0)
    mesh = prepare_mesh(transformed(joined({"slab": slab, "thing": thing}), over), MeshOptions(target_faces=400))
    ground = ground_of(mesh)
    assert len(ground) > 4
    np.testing.assert_allclose(ground[1], [0.0, 0.0, turn], atol=1e-6)
