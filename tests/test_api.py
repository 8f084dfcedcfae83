"""The Python names of the contract: all there, loaded when used, and callable in whatever order things are imported."""

import subprocess
import sys

import pytest

import relight3d

HEAVY = ("open3d", "pymeshlab", "embreex", "scipy", "skimage", "numba", "matplotlib", "rich", "tyro", "imagecodecs")


def run_python(code: str) -> str:
    """What a fresh interpreter prints; a failure shows its own traceback."""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.strip()


def test_every_name_can_be_had() -> None:
    for name in relight3d.__all__:
        assert getattr(relight3d, name) is not None, name
    assert set(relight3d.__all__) <= set(dir(relight3d))


def test_names_are_those_of_their_modules() -> None:
    from relight3d.camera import Camera
    from relight3d.lights import DirectionalLight
    from relight3d.recover.run import RecoverOptions

    assert relight3d.Camera is Camera
    assert relight3d.DirectionalLight is DirectionalLight
    assert relight3d.RecoverOptions is RecoverOptions


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'relit'"):
        _ = relight3d.relit  # pyright: ignore[reportAttributeAccessIssue]


def test_version_is_the_installed_one() -> None:
    assert relight3d.__version__.count(".") == 2


@pytest.mark.parametrize("before", ["", "import relight3d.recover.run", "import relight3d.recover"])
@pytest.mark.parametrize("after", ["", "import relight3d.recover.run", "from relight3d.recover import run"])
def test_recover_is_callable_in_every_order(before: str, after: str) -> None:
    # The subpackage of the same name would hide the function once any of its modules is imported.
    use = "assert callable(relight3d.recover)\nfrom relight3d import recover\nassert callable(recover)"
    modules = "assert relight3d.recover.run.RecoverOptions is relight3d.RecoverOptions"
    run_python("\n".join([before, "import relight3d", use, after, use, "import relight3d.recover.run", modules, use]))


def test_evaluate_is_callable_beside_its_modules() -> None:
    printed = run_python(
        "import relight3d, relight3d.evaluate.metrics as metrics, inspect\n"
        "assert metrics.psnr_db is relight3d.evaluate.metrics.psnr_db\n"
        "print(*inspect.signature(relight3d.evaluate).parameters)"
    )
    assert printed.startswith("model capture split")


def test_a_called_package_calls_its_function(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("relight3d.evaluate.run.evaluate", lambda *args, **kwargs: (args, kwargs))
    assert relight3d.evaluate(1, 2, split="none") == ((1, 2), {"split": "none"})  # pyright: ignore


def test_import_loads_nothing_heavy() -> None:
    printed = run_python(f"import relight3d, sys; print(*[name for name in {HEAVY} if name in sys.modules])")
    assert printed == ""


def test_lights_and_cameras_load_no_engine() -> None:
    # A script that only prepares lights should not wait for Open3D, SciPy or the kernels.
    use = "relight3d.DirectionalLight((0, 0, 1), (1, 1, 1)); relight3d.Camera(4, 3, 5, 5, 2, 1.5)"
    heavy = [name for name in HEAVY if name != "rich"]
    assert run_python(f"import relight3d, sys; {use}; print(*[n for n in {heavy} if n in sys.modules])") == ""


def test_import_is_fast() -> None:
    # 0.4 s is what was asked for; it takes a tenth of that, so a busy machine does not fail this.
    code = "import time; t = time.perf_counter(); import relight3d; print(time.perf_counter() - t)"
    assert min(float(run_python(code)) for _ in range(3)) < 0.4
