"""Relight a photographed scene: recover its reflectance and light transport, then render it under any lights.

Each name is loaded when it is first used, so that `import relight3d` costs next to nothing.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the same names for editors and type checkers
    from relight3d.camera import Camera as Camera
    from relight3d.camera import look_at as look_at
    from relight3d.display.report import report as report
    from relight3d.display.viewer import view as view
    from relight3d.errors import DisplayError as DisplayError
    from relight3d.errors import InputError as InputError
    from relight3d.errors import MeshError as MeshError
    from relight3d.errors import ModelFileError as ModelFileError
    from relight3d.evaluate.run import evaluate as evaluate
    from relight3d.evaluate.study import study as study
    from relight3d.io.capture import load_capture as load_capture
    from relight3d.io.capture import write_capture as write_capture
    from relight3d.io.model_file import load_model as load_model
    from relight3d.lights import DirectionalLight as DirectionalLight
    from relight3d.lights import PointLight as PointLight
    from relight3d.lights import RectangleLight as RectangleLight
    from relight3d.lights import SphereLight as SphereLight
    from relight3d.lights import SpotLight as SpotLight
    from relight3d.records import Capture as Capture
    from relight3d.records import Frame as Frame
    from relight3d.records import RelightModel as RelightModel
    from relight3d.recover.run import RecoverOptions as RecoverOptions
    from relight3d.recovery import recover as recover
    from relight3d.relight.relighter import Relighter as Relighter

    __version__: str

_NAMES = {
    "io.capture": ("load_capture", "write_capture"),
    "io.model_file": ("load_model",),
    "recovery": ("recover",),
    "recover.run": ("RecoverOptions",),
    "relight.relighter": ("Relighter",),
    "records": ("Capture", "RelightModel", "Frame"),
    "camera": ("Camera", "look_at"),
    "lights": ("DirectionalLight", "PointLight", "SpotLight", "SphereLight", "RectangleLight"),
    "evaluate.run": ("evaluate",),
    "evaluate.study": ("study",),
    "display.viewer": ("view",),
    "display.report": ("report",),
    "errors": ("InputError", "MeshError", "ModelFileError", "DisplayError"),
}
_HOME = {name: f"{__name__}.{module}" for module, names in _NAMES.items() for name in names}
__all__ = [*_HOME, "__version__"]  # pyright: ignore[reportUnsupportedDunderAll]


class _CallablePackage(ModuleType):
    """A subpackage named like its main function: its modules are found in it, and calling it calls the function."""

    @property
    def __wrapped__(self) -> Any:  # what inspect.signature and help() show
        name = self.__name__.rpartition(".")[2]
        return getattr(import_module(_HOME[name]), name)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self.__wrapped__(*args, **kwargs)


class _Facade(ModuleType):
    """relight3d itself, which sees to it that what becomes its `recover` and `evaluate` can be called.

    The import system binds a subpackage here when any of its modules is imported, and would hide the function.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _HOME and isinstance(value, ModuleType):
            value.__class__ = _CallablePackage
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Facade


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(_HOME[name])
    # A callable subpackage is bound by the import itself, and stays.
    return globals().setdefault(name, getattr(module, name))


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
