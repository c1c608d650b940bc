"""`unwrinkle render`: the truth of its towel, and bad options; its pair in `test_pair_commands`."""

import sys
from pathlib import Path

import numpy as np
import pytest

from unwrinkle import cli
from unwrinkle.commands.render import truth_of
from unwrinkle.simulation.rendering.synthetic_towel import wrinkled_towel


def _main(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["unwrinkle", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
        raise SystemExit(0)
    return int(stop.value.code or 0)


def test_truth_is_the_towel_on_whole_multiples_of_the_resolution() -> None:
    towel = wrinkled_towel(4)
    truth = truth_of(towel, 0.002)
    np.testing.assert_allclose(truth.origin / 0.002, np.rint(truth.origin / 0.002), atol=1e-6)
    low_x, high_x, low_y, high_y = truth.extent
    assert low_x < -0.28 < 0.28 < high_x and low_y < -1.38 < -0.82 < high_y
    top = truth.cell_from_world(np.array(towel.ridges[0].centre)).round().astype(int)
    assert truth.height[top[1], top[0]] == pytest.approx(0.023, abs=0.0005)
    assert truth.garment.sum() * 0.002**2 == pytest.approx(towel.side**2, rel=0.01)
    assert not truth.height[~truth.garment].any()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--garment", "sock"], "'sock': unknown; known are towel, flat"),
        (["--texture", "silk"], "'silk': unknown"),
        (["--scale", "0.3"], "scale 0.3"),
        (["--gaze-at", "0"], "give X,Y"),
        (["--gaze-at", "nan,0"], "give X,Y"),
        (["--gaze-at", "0,3"], "left eye"),
    ],
)
def test_bad_options_are_one_line_and_leave_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    words: str,
) -> None:
    assert _main(monkeypatch, "render", "--out", tmp_path / "pair", *options) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and words in message, message
    assert list(tmp_path.iterdir()) == []
