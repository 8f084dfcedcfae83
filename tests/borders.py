"""What shadow borders are compared with."""

import numpy as np

# Four rays about a pixel's centre, no two in one row or column.
FOUR_RAYS = np.array([(-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125)], np.float32)
