"""``unwrinkle show`` and ``unwrinkle preview`` as a user runs them, and the view of the cell."""

import base64
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.perception.target import FlatteningTarget, HandTarget
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.viewer.cell_view import CellView
from unwrinkle.viewer.scene import start_meshcat
from unwrinkle.viewer.text_panel import text_panel

pytestmark = pytest.mark.alone

Main = Callable[..., int]


@pytest.fixture(scope="module")
def cell() -> Cell:
    return load_cell()


@pytest.fixture(scope="module")
def plan_file(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> Path:
    hands = tuple(
        HandTarget(np.array([x, -1.1, 0.7]), np.array([-u, 0.0]), np.array([u, 0.0]), 0.02)
        for x, u in ((0.2, 1.0), (-0.2, -1.0))
    )
    target = FlatteningTarget(
        (hands[0], hands[1]), np.array([0.0, -1.1, 0.71]), np.array([0.0, 1.0]), 0.44, "foot"
    )
    plan = FlatteningPlanner(cell).plan(target).plan
    assert plan is not None
    path = tmp_path_factory.mktemp("plan") / "good.npz"
    plan.save(path)
    return path


@pytest.mark.end_to_end
def test_preview_writes_a_page(
    main: Main, plan_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "new" / "page.html"
    assert main("preview", plan_file, "--html", page, "--at", "0.5") == 0
    plan = FlatteningPlan.load(plan_file)
    text = page.read_text(encoding="utf-8")
    panel = text[text.index('<div id="panel">') :]
    assert plan.content_hash in panel
    assert re.search(
        r'class="verdict pass"><b>verified</b> smallest clearance <b>\d+\.\d mm', panel
    )
    assert '"at": 0.5' in panel
    assert page.stat().st_size < 10_000_000
    out = capsys.readouterr().out
    assert f"{page}: plan {plan.content_hash}" in out
    assert "is verified against the model of the cell; smallest clearance" in out


def test_preview_of_an_unverified_plan_exits_3_with_its_page(
    main: Main, plan_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import dataclasses as dc

    good = FlatteningPlan.load(plan_file)
    late = dc.replace(good.events[0], time=good.events[0].time + 0.1)
    bad, page = tmp_path / "bad.npz", tmp_path / "bad.html"
    dc.replace(good, events=(late, good.events[1])).save(bad)
    assert main("preview", bad, "--html", page) == 3
    assert '<p class="verdict fail"><b>NOT verified</b>' in page.read_text(encoding="utf-8")
    error = capsys.readouterr().err
    assert "NOT verified" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--no-live"], "nothing to show"),
        (["--html", "PAGE", "--at", "99"], "--at 99: the plan lasts from 0 to"),
        (["--html", "PAGE", "--at", "nan"], "--at nan"),
        (["--html", "PAGE", "--scenario", "missing.yaml"], "missing.yaml: no such file"),
    ],
)
def test_preview_refuses_bad_options_and_writes_nothing(
    main: Main,
    plan_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    page = tmp_path / "page.html"
    words = [str(page) if word == "PAGE" else word for word in arguments]
    assert main("preview", plan_file, *words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("unwrinkle: ")
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert not page.exists()


def test_preview_refuses_a_damaged_plan(
    main: Main, plan_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.html"
    content = bytearray(plan_file.read_bytes())
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(content[: len(content) // 2])
    for path in (damaged, tmp_path / "missing.npz"):
        assert main("preview", path, "--html", page) == 2
        error = capsys.readouterr().err
        assert str(path) in error
        assert error.count("\n") == 1
    assert not page.exists()


@pytest.mark.end_to_end
def test_show_writes_a_page_of_the_cell(
    main: Main, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "cell.html"
    assert main("show", "--html", page, "--state", "ext_plus_90") == 0
    assert f"written to {page}" in capsys.readouterr().out
    text = page.read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    payload = re.findall(r'fetch\("data:application/octet-binary;base64,([^"]*)"', text)
    sent = b"".join(base64.b64decode(part) for part in payload)
    for layer in (b"illustration", b"proximity"):
        assert layer + b"/r2_gripper/lower_finger" in sent
    assert page.stat().st_size < 5_000_000


def test_show_refuses_an_unknown_state(
    main: Main, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "cell.html"
    assert main("show", "--html", page, "--state", "asleep") == 2
    assert "there is no state 'asleep'; the robot has home, " in capsys.readouterr().err
    assert not page.exists()


# ---------------------------------------------------------------- view of the cell


def _click(meshcat: Any, name: str) -> None:
    """Return the message of a click, as msgpack."""
    text = name.encode()
    message = b"\x82\xa4type\xa6button\xa4name\xd9" + bytes([len(text)]) + text
    meshcat._InjectWebsocketMessage(message=message)


def test_view_follows_sliders_and_named_states(cell: Cell) -> None:
    meshcat = start_meshcat()
    view = CellView(cell, meshcat)
    view.add_controls()
    sliders = list(meshcat.GetSliderNames())
    assert len(sliders) == 13 + 2 + 4
    assert set(cell.robot.named_states) <= set(meshcat.GetButtonNames())

    home = view.update()
    before = meshcat._GetPackedTransform("/drake/illustration/r1/link_7")
    _click(meshcat, "xtion1_above_table")
    there = view.update()
    wanted = cell.robot.named_states["xtion1_above_table"]
    assert np.count_nonzero(there != home) == np.count_nonzero(wanted)
    np.testing.assert_allclose(np.sort(there)[-1], max(wanted), atol=0.02)
    assert meshcat._GetPackedTransform("/drake/illustration/r1/link_7") != before

    grip = next(name for name in sliders if "grip" in name)
    finger = meshcat._GetPackedTransform("/drake/illustration/r1_gripper/upper_finger")
    meshcat.SetSliderValue(grip, 0.0)
    view.update()
    assert meshcat._GetPackedTransform("/drake/illustration/r1_gripper/upper_finger") != finger


def test_view_toggles_the_collision_shapes(cell: Cell) -> None:
    meshcat = start_meshcat()
    view = CellView(cell, meshcat)
    view.add_controls()
    for shown in (False, True):
        _click(meshcat, "show / hide collision shapes")
        view.update()
        packed = meshcat._GetPackedProperty("/drake/proximity", "visible")
        assert packed.endswith(b"\xa5value" + (b"\xc3" if shown else b"\xc2"))


def test_viewer_on_a_taken_port_is_an_input_error() -> None:
    first = start_meshcat()
    with pytest.raises(
        InputError, match=f"the viewer cannot listen on localhost, port {first.port()}"
    ):
        start_meshcat(port=first.port())


def test_text_panel_is_a_textured_rectangle_of_the_right_shape() -> None:
    meshcat = start_meshcat()
    shape = text_panel([("plan 0123", "#14692d"), ("a longer second line", "#3b4654")], 0.5)
    document = json.loads(shape.source().in_memory().mesh_file.contents())
    low, high = (np.array(document["accessors"][0][key]) for key in ("min", "max"))
    assert high[1] - low[1] == pytest.approx(0.5)
    assert high[0] == pytest.approx(-low[0])
    assert high[0] - low[0] > 1.0
    assert document["images"][0]["uri"].startswith("data:image/png;base64,iVBOR")
    meshcat.SetObject("plan/text panel", shape)
    assert meshcat.HasPath("plan/text panel")
