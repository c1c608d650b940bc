"""Every example runs."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))
#: Run by tests/unwrinkle/closed_loop/test_flatten_end_to_end.py, which looks at what they write.
ELSEWHERE = {"flatten_in_simulation"}
#: Examples that run virtual devices on the computer's clock.
IN_REAL_TIME = {"check_a_site", "execute_on_the_virtual_controller"}


@pytest.mark.end_to_end
@pytest.mark.parametrize(
    "example",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.alone] * (path.stem in IN_REAL_TIME))
        for path in EXAMPLES
        if path.stem not in ELSEWHERE
    ],
)
def test_example_runs(example: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(example)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert len(example.read_text().splitlines()) < 80


def test_there_are_examples() -> None:
    assert len(EXAMPLES) >= 3
    assert {path.stem for path in EXAMPLES} >= IN_REAL_TIME | ELSEWHERE
