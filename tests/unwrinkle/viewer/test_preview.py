"""The preview of a plan: the moving scene, the page around it, and the live controls."""

import base64
import dataclasses as dc
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import (
    FlatteningPlan,
)
from unwrinkle.planning.search.key_poses import POSES
from unwrinkle.planning.verification.verdict import PairClearance, Verdict, Violation
from unwrinkle.viewer.overlay import POLICY, PreviewSummary
from unwrinkle.viewer.plan_shapes import pull_magnification
from unwrinkle.viewer.preview import LivePreview, PlanScene, preview_page
from unwrinkle.viewer.scene import start_meshcat

pytestmark = pytest.mark.alone

LARGEST_PAGE = 10_000_000
SUMMARY = PreviewSummary(True, 0.0213, "r1::link_5 – r2::link_5", 1.234)


@pytest.fixture(scope="module")
def page(plan: FlatteningPlan, cell: Cell) -> str:
    return preview_page(plan, cell, SUMMARY, title="towel <1>.npz", at=1.4)


def _payloads(page: str) -> list[bytes]:
    """Return the packed commands that the page sends to its viewer."""
    found = re.findall(r'fetch\("data:application/octet-binary;base64,([^"]*)"', page)
    return [base64.b64decode(text) for text in found]


# ---------------------------------------------------------------- scene


def test_scene_holds_all_that_is_to_be_seen(plan: FlatteningPlan, cell: Cell) -> None:
    meshcat = start_meshcat()
    PlanScene(plan, cell, meshcat)
    paths = ["plan/garment", "plan/outline", "plan/wrinkle"]
    for arm in ("right", "left"):
        paths += [f"plan/{kind}/{arm}" for kind in ("grasp", "pull", "tip path")]
        paths += [f"plan/poses/{arm}/{k + 1} {name}" for k, name in enumerate(POSES)]
    for layer in ("illustration", "proximity"):
        paths += [f"{layer}/{body}" for body in ("r1/link_7", "r2_gripper/upper_finger", "t2")]
    assert [path for path in paths if not meshcat.HasPath(path)] == []


def test_scene_of_one_arm_without_garment(plan: FlatteningPlan, cell: Cell) -> None:
    meshcat = start_meshcat()
    PlanScene(dc.replace(plan, arms=(None, plan.arms[1]), garment=None), cell, meshcat)
    assert meshcat.HasPath("plan/wrinkle")
    assert meshcat.HasPath("plan/pull/left")
    for path in ("plan/garment", "plan/outline", "plan/pull/right", "plan/poses/right"):
        assert not meshcat.HasPath(path)


def test_show_moves_arm_turntable_and_fingers(plan: FlatteningPlan, cell: Cell) -> None:
    meshcat = start_meshcat()
    scene = PlanScene(plan, cell, meshcat)
    bodies = ["r1/link_7", "r2/link_2", "turntable/r750", "r1_gripper/upper_finger"]

    def places(layer: str) -> list[bytes]:
        return [meshcat._GetPackedTransform(f"/drake/{layer}/{body}") for body in bodies]

    for layer in ("illustration", "proximity"):
        scene.show(0.0)
        before = places(layer)
        assert all(before)
        scene.show(1.2)
        after = places(layer)
        assert all(a != b for a, b in zip(before, after, strict=True))
    scene.show(1.6)  # the arms rest; only the driven blade has moved on
    now = places("proximity")
    assert now[:3] == after[:3]
    assert now[3] != after[3]


def test_scene_refuses_a_plan_for_another_cell(plan: FlatteningPlan, cell: Cell) -> None:
    with pytest.raises(InputError, match="another model of the cell"):
        PlanScene(dc.replace(plan, robot_hash="0" * 64), cell, start_meshcat())


# ---------------------------------------------------------------- page


def test_page_is_self_contained(page: str) -> None:
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert policy[1] == POLICY
    assert policy[1].startswith("default-src 'none';")
    assert not re.search(r"https?:|wss?:|\*", policy[1])
    # The policy precedes everything that could load something.
    assert page.index(POLICY) < page.index("<script")
    assert re.findall(r"<script[^>]*\ssrc=|<link\b|@import|<iframe", page.split("</head>")[0]) == []
    panel = page[page.index('<div id="panel">') :]
    assert re.findall(r"https?://|wss?://|\ssrc=|\shref=|url\(", panel) == []
    assert re.findall(r'fetch\("(?!data:)', page) == []


def test_page_shows_hash_verdict_and_clearance(page: str, plan: FlatteningPlan) -> None:
    panel = page[page.index('<div id="panel">') :]
    assert plan.content_hash in panel
    assert f"<b>{plan.content_hash[:12]}</b>" in panel
    assert '<p class="verdict pass"><b>verified</b>' in panel
    assert "21.3 mm, r1::link_5 – r2::link_5, at 1.23 s" in panel
    assert "motion 3.00 s, with the grippers 4.50 s" in panel
    assert "pull 20.0 mm (right) and 10.0 mm (left)" in panel
    assert "not simulated" in panel
    for k, name in enumerate(POSES):
        assert f"<span>{k + 1} {name}</span>" in panel
    assert "@@" not in panel
    assert f"<title>Flattening plan {plan.content_hash[:12]}: towel &lt;1&gt;.npz</title>" in page
    assert "towel <1>" not in page


def test_page_carries_the_motion(page: str, plan: FlatteningPlan) -> None:
    animations = [data for data in _payloads(page) if b"set_animation" in data]
    assert len(animations) == 1
    for layer in (b"illustration", b"proximity"):
        for body in (b"r1/link_7", b"r2/link_7", b"turntable/r750", b"r1_gripper/upper_finger"):
            assert layer + b"/" + body in animations[0]
    data = json.loads(re.findall(r'id="plan-data">(.*?)</script>', page)[0])
    assert data["at"] == 1.4
    assert data["duration"] == pytest.approx(4.5)
    assert len(data["times"]) == 9
    assert {"overview", "garment", "above", "right grasp", "left grasp"} <= set(data["views"])
    assert [label["text"] for label in data["labels"]] == [
        "right pull 20.0 mm",
        "left pull 10.0 mm",
    ]


def test_viewer_still_has_what_the_panel_calls(page: str) -> None:
    """The panel drives Meshcat's animator, which is not a documented interface."""
    for piece in ("class Animator{", "seek(", "display_progress(", "set_camera_target("):
        assert piece in page


def test_largest_page_is_under_ten_megabytes(
    waving_plan: Callable[..., FlatteningPlan], cell: Cell
) -> None:
    plan = waving_plan(stretch=15.0, vertices=100)
    page = preview_page(plan, cell, SUMMARY)
    assert 3_000_000 < len(page.encode()) < LARGEST_PAGE


def test_failed_plan_is_marked_and_its_reasons_are_text(plan: FlatteningPlan, cell: Cell) -> None:
    lines = ("velocity <b>high</b>", *(f"reason {k}" for k in range(20)))
    summary = PreviewSummary(False, None, lines=lines)
    page = preview_page(dc.replace(plan, note="one <arm>"), cell, summary)
    panel = page[page.index('<div id="panel">') :]
    assert '<p class="verdict fail"><b>NOT verified</b>' in panel
    assert "velocity &lt;b&gt;high&lt;/b&gt;" in panel
    assert "reason 6" in panel
    assert "reason 7" not in panel
    assert "and 13 more" in panel
    assert "one &lt;arm&gt;" in panel


def test_pull_arrows_are_magnified_by_what_fits(plan: FlatteningPlan) -> None:
    def magnified(distance: float) -> int:
        hands = tuple(dc.replace(hand, pull_distance=distance) for hand in plan.target.hands)
        target = dc.replace(plan.target, hands=hands, geodesic_distance=2.0)
        return pull_magnification(dc.replace(plan, target=target))

    assert [magnified(d) for d in (0.0, 0.01, 0.03, 0.05, 0.2)] == [5, 5, 4, 2, 1]


def test_summary_of_a_verdict() -> None:
    pair = PairClearance(
        bodies=("r1::link_5", "t2::desk"),
        kind="arm-table",
        distance=0.0317,
        time=1.5,
        bound=0.03,
        required=0.02,
        margin=0.0117,
    )
    verdict = Verdict("a", "b", "c", (), (Violation("jerk", "too much"),), (pair,), 0.1, 7)
    summary = PreviewSummary.of(verdict)
    assert not summary.passed
    assert summary.clearance_text == "31.7 mm, r1::link_5 – t2::desk, at 1.50 s"
    assert summary.lines == ("too much",)
    far = PreviewSummary.of(dc.replace(verdict, clearances=(), violations=()))
    assert far.passed
    assert far.clearance is None
    assert far.lines == ("no two bodies nearer than 100 mm",)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium here")
def test_page_opens_in_a_browser_at_the_time_asked_for(page: str, tmp_path: Path) -> None:
    """The scripts run under the page's own policy: panel, labels and robot are at the time `at`."""
    path = tmp_path / "preview.html"
    path.write_text(page, encoding="utf-8")
    command = ["chromium", "--headless=new", "--no-sandbox", "--disable-dev-shm-usage"]
    command += ["--ignore-gpu-blocklist", "--use-angle=swiftshader"]
    command += ["--enable-unsafe-swiftshader", "--virtual-time-budget=6000"]
    command += ["--enable-logging=stderr", "--dump-dom"]
    result = subprocess.run(
        [*command, f"--user-data-dir={tmp_path / 'profile'}", path.as_uri()],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    dom = result.stdout
    assert re.search(r'<span id="now">1\.40 s</span>', dom), result.stderr[-2000:]
    assert re.search(r'class="step now"[^>]*data-step="3"', dom)
    assert re.search(r'class="tag"[^>]*left: \d', dom)
    assert not re.search(r"CONSOLE.*(Error|Refused|violates)", result.stderr)


# ---------------------------------------------------------------- live


def _click(meshcat: Any, name: str) -> None:
    """Return the message of a click, as msgpack."""
    text = name.encode()
    message = b"\x82\xa4type\xa6button\xa4name\xd9" + bytes([len(text)]) + text
    meshcat._InjectWebsocketMessage(message=message)


def test_live_controls(plan: FlatteningPlan, cell: Cell) -> None:
    meshcat = start_meshcat()
    live = LivePreview(plan, cell, SUMMARY, meshcat)
    names = list(meshcat.GetButtonNames())
    assert f"plan {plan.content_hash[:12]}: verified" in names
    assert "smallest clearance 21.3 mm, r1::link_5 – r2::link_5, at 1.23 s" in names
    assert meshcat.HasPath("plan/text panel")

    assert live.update(0.5) == pytest.approx(0.5)  # it opens playing
    meshcat.SetSliderValue("speed", 0.5)
    assert live.update(1.0) == pytest.approx(1.0)
    _click(meshcat, "play / pause")
    assert live.update(1.0) == pytest.approx(1.0)
    pose = next(name for name in names if name.endswith(": put-on-table"))
    _click(meshcat, pose)
    assert live.update(1.0) == pytest.approx(2.75)
    meshcat.SetSliderValue("time (s)", 0.25)
    assert live.update(1.0) == pytest.approx(0.25)
    _click(meshcat, "play / pause")
    meshcat.SetSliderValue("speed", 1.0)
    assert live.update(4.0) == pytest.approx(4.25)
    assert live.update(4.0) == 0.0  # it restarts


def test_live_ends_when_told(plan: FlatteningPlan, cell: Cell) -> None:
    live = LivePreview(plan, cell, SUMMARY, start_meshcat())
    rounds = iter([False, False, True])
    live.run(lambda: next(rounds))
    assert next(rounds, None) is None
