"""Open3D, loaded when this module is. Untyped: its stubs do not know that it takes NumPy arrays."""

from typing import Any

import open3d as _open3d
from open3d.visualization import gui as _gui
from open3d.visualization import rendering as _rendering

open3d: Any = _open3d
gui: Any = _gui
rendering: Any = _rendering
