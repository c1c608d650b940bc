"""Start and end of the viewer."""

import subprocess
import sys
from pathlib import Path


def test_viewers_end_whatever_drake_logs(tmp_path: Path) -> None:
    """Regression: with Drake's logger at DEBUG, Meshcat's destructor deadlocked with its thread."""
    script = (
        "import logging, pydrake.geometry\n"
        "from unwrinkle.viewer.scene import start_meshcat\n"
        "logging.basicConfig(level=logging.DEBUG)\n"
        "logging.getLogger('drake').setLevel(logging.DEBUG)\n"
        "for _ in range(5):\n"
        "    viewer = start_meshcat()\n"
        "    del viewer\n"
        "print('ended')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stdout.strip() == "ended", done.stderr
