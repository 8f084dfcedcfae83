"""A stopped run ends in one line and leaves nothing: real processes, real signals."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands.asserts import TINY


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize(
    ("sent", "status", "said"), [(signal.SIGINT, 130, "relight3d: stopped\n"), (signal.SIGTERM, 143, "")]
)
def test_a_stopped_recovery_leaves_nothing(tmp_path: Path, sent: signal.Signals, status: int, said: str) -> None:
    output = tmp_path / "out" / "tiny.relight"
    process = subprocess.Popen(
        [sys.executable, "-m", "relight3d", "recover", str(TINY), "-o", str(output)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Whoever started the tests in the background had them ignore Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert process.stdout is not None and process.stderr is not None
    assert "mesh" in process.stderr.readline()  # its first stage has begun
    process.send_signal(sent)
    out, err = process.communicate(timeout=120)
    assert process.returncode == status and out == "", err
    assert err.endswith(said) and "Traceback" not in err
    assert not output.exists() and not list(tmp_path.rglob(".*"))
