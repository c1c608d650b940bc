"""The report page of a run: whole, killed, damaged, empty; its pictures and charts."""

import base64
import dataclasses as dc
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.report.charts import Series, line_chart, stage_chart
from unwrinkle.report.page import report_page, write_report
from unwrinkle.report.pictures import (
    BORDER,
    FOLD_LINE,
    WIDTH,
    Picture,
    Window,
    analysis_marks,
    camera_picture,
    relief,
    seen_from_above,
    top_height,
)
from unwrinkle.runs.folder import ActionRecord, RunFolder, RunSettings

SETTINGS = RunSettings("towel", "terry", "bunched", 7, "stereo", 0.5, "any", "foot", 10)


@pytest.fixture(scope="module")
def run(synthetic_run: Any, tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return synthetic_run.write(tmp_path_factory.mktemp("runs") / "whole")


@pytest.fixture(scope="module")
def page(run: RunFolder) -> str:
    return report_page(run)


def _sections(page: str) -> list[str]:
    return re.findall(r'<section id="look\d+">.*?</section>', page, re.DOTALL)


def test_page_says_what_came_of_the_run(page: str) -> None:
    assert "<title>Flattening run whole</title>" in page
    close = re.sub(r">\s+<", "><", page)
    assert '<span class="status good">flat</span><p>no wrinkle asks for' in close
    assert "<b>2</b><span>actions, of 10 at most</span>" in page
    assert "<b>94.0 → 98.0 %</b><span>coverage</span>" in page
    assert "<b>21.0 → 15.0 mm</b><span>largest true height</span>" in page
    assert "<b>1 min 1 s</b>" in page
    assert "unwrinkle flatten --seed 7" in page
    assert "are simulated" in page
    assert "@@" not in page


def test_page_has_a_card_for_each_look(page: str, run: RunFolder, synthetic_run: Any) -> None:
    cards = _sections(page)
    assert len(cards) == 3
    assert [card.count("data:image/jpeg;base64,") for card in cards] == [3, 3, 2]
    assert [re.findall("<h2>(.*?)<", card)[0] for card in cards] == [
        "Action 1",
        "Action 2",
        "Look 3",
    ]
    assert cards[0].count('<tr class="pulled">') == 1
    assert "<h3>3 wrinkles, largest first</h3>" in cards[0]
    plan, verdict = synthetic_run.plans[0], synthetic_run.verdicts[0]
    assert plan.content_hash[:12] in cards[0]
    assert f"verified, {len(verdict.checks)} checks" in cards[0]
    assert f"{1e3 * verdict.smallest.distance:.1f} mm" in cards[0]
    assert "94.0 → 96.0 %" in cards[0]
    assert "0.40 mrad" in cards[0]
    assert run.look(0).analysis()["wrinkles"][0]["curve"]


def test_page_is_self_contained_and_small(page: str) -> None:
    assert "content=\"default-src 'none';" in page
    assert page.index("Content-Security-Policy") < page.index("<style")
    assert re.findall(r"<script|<link|https?://|url\(|@import|<iframe", page) == []
    assert set(re.findall(r'src="(.{11})', page)) == {"data:image/"}
    assert 5.0 * len(page) < 6_000_000  # ten actions


def test_report_is_written_into_the_folder(run: RunFolder) -> None:
    path = write_report(run)
    assert path == run.path / "report.html"
    assert path.read_text(encoding="utf-8").endswith("</html>\n")


def test_page_of_a_killed_run_shows_what_is_there(synthetic_run: Any, tmp_path: Path) -> None:
    run = synthetic_run.write(tmp_path / "killed", status="running")
    page = report_page(RunFolder.open(run.path))
    assert "no end recorded" in page
    assert "was killed" in page
    cards = _sections(page)
    assert len(cards) == 2
    assert "not finished" in cards[1]
    assert "no look after this action" in cards[1]
    assert "94.0 → 96.0 %" in page


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        ("range_map.npz", "no range map was made"),
        ("analysis.json", "No analysis was made."),
        ("left.png", "image of the camera"),
        ("head.yaml", "image of the camera"),
        ("plan.npz", "verdict"),
        ("action.json", "not finished"),
    ],
)
@pytest.mark.parametrize("damage", [False, True])
def test_page_does_without_a_file(
    synthetic_run: Any, tmp_path: Path, missing: str, said: str, damage: bool
) -> None:
    run = synthetic_run.write(tmp_path / "run", status="running")
    path = run.look(0).path / missing
    path.write_bytes(path.read_bytes()[:40]) if damage else path.unlink()
    first = _sections(report_page(run))[0]
    assert said in first
    assert '<figure><div class="picture"><img' in first or missing == "range_map.npz"


def test_page_of_a_run_without_looks_and_of_a_look_without_files(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "run", SETTINGS)
    run.event(0.0, "look", "begun <b>")
    run.finish("fault", "the camera gave <nothing>")
    page = report_page(run)
    assert "The run ended before the first look." in page
    assert "the camera gave &lt;nothing&gt;" in page
    assert "begun &lt;b&gt;" in page
    assert "<nothing>" not in page
    run.look(0).save_action(ActionRecord(0, "refused", "empty table"))
    page = report_page(run)
    assert "no range map was made" in page
    assert '<span class="status fair">refused</span>' in page
    assert "coverage (not known)" in page


# ---------------------------------------------------------------- pictures


def _hill(x: float, y: float, *, colour: bool = False) -> RangeMap:
    """Return a map of 0.4 m covered by a garment that is flat except for a hill."""
    cells = 0.002 * np.arange(201) - 0.2
    far = (cells[None, :] - x) ** 2 + (cells[:, None] - 1.1 - y) ** 2
    on = np.ones((201, 201), dtype=bool)
    height = (0.03 * np.exp(-far / 0.02**2)).astype(np.float32)
    picture = np.zeros((201, 201, 3), dtype=np.uint8)
    picture[far < 0.02**2] = (250, 20, 20)
    origin = np.array([-0.2, -1.3])
    return RangeMap(height, on, on, 0.002, origin, 0.7, "stereo", picture if colour else None)


def _decoded(picture: Picture) -> np.ndarray:
    bgr = cv2.imdecode(np.frombuffer(picture.jpeg, dtype=np.uint8), cv2.IMREAD_COLOR)
    assert bgr is not None
    return np.asarray(bgr[..., ::-1], dtype=float)


def test_pictures_are_seen_from_the_robot() -> None:
    """World x points left and y down; the hill is at its projection in both pictures."""
    hill = _hill(0.1, -1.15, colour=True)
    top = np.array([[0.1, -1.15]])
    window = Window.around([hill])
    assert window.x_min == pytest.approx(-0.271)  # a margin, less a hundredth of the cells
    (u, v), (left, _), (_, low) = window.project(
        np.vstack([top, top + [[0.05, 0.0]], top + [[0.0, 0.05]]])
    )
    assert left < u
    assert low > v
    shaded = relief(hill, window, 0.03)
    assert (shaded.width, shaded.height) == (WIDTH, window.shape[0])
    blue = _decoded(shaded)
    assert blue[int(v), int(u)].sum() < 0.6 * blue[int(v), int(u) + 120].sum()
    above = seen_from_above(hill, window)
    assert above is not None
    red = _decoded(above)[..., 0] > 200
    found = np.argwhere(red).mean(axis=0)[::-1]
    np.testing.assert_allclose(found, [u, v], atol=2.0)
    assert seen_from_above(_hill(0.0, -1.1), window) is None
    assert 0.015 < top_height([hill]) < 0.03  # not the peak: a few outliers may be higher
    astray = dc.replace(hill, origin=hill.origin + 0.3)
    assert Window.around([hill, astray, hill]) == window
    with pytest.raises(InputError, match="none has a garment"):
        Window.around([])


def test_marks_lie_on_the_cameras_picture_where_the_wrinkle_is(tmp_path: Path) -> None:
    """The ridge line through a world point ends on the white spot at the point's projection."""
    head = nominal_head()
    gaze = head.gaze_at(np.array([0.0, -1.1, 0.7]))
    camera, scale = head.left.camera, 0.25
    point = np.array([[0.06, -1.05, 0.71]])
    u, v = camera.project(transformed(inverse(head.poses(gaze)[0]), point))[0] * scale
    shape = (round(camera.height * scale), round(camera.width * scale), 3)
    image = np.zeros(shape, dtype=np.uint8)
    cv2.circle(image, (round(u), round(v)), 12, (255, 255, 255), -1)
    look = RunFolder.create(tmp_path / "run", SETTINGS).look(0)
    look.save_pair(image, image, gaze)
    curve = [(point[0] - [0.0, 0.1, 0.0]).tolist(), point[0].tolist()]
    data = {"wrinkles": [{"curve": curve}], "target": {"wrinkle": 0}}
    picture = camera_picture(look, Window(-0.3, 0.3, -1.4, -0.8), 0.7, data)
    white = np.argwhere(_decoded(picture)[..., 0] > 128).mean(axis=0)[::-1]
    points = re.findall(r'points="([^"]*)"', picture.marks)[0].split(" ")
    end = np.array([float(word) for word in points[-1].split(",")])
    np.testing.assert_allclose(end, white, atol=2.0)
    assert picture.width == WIDTH
    look.save_pair(image, image, dc.replace(Gaze(), left_pan=np.deg2rad(40.0)))
    elsewhere = camera_picture(look, Window(-0.3, 0.3, -1.4, -0.8), 0.7, None)
    assert elsewhere.width == WIDTH  # the table is outside the image


def test_marks_number_the_wrinkles_and_skip_what_is_empty(run: RunFolder) -> None:
    data = run.look(0).analysis()
    window = Window(-0.3, 0.3, -1.4, -0.8)
    marks = analysis_marks(data, window.project)
    assert re.findall(r">(\d)</text>", marks) == ["3", "2", "1"]
    assert marks.count("<polygon") == 4  # two approaches, two pulls
    only = analysis_marks(data, window.project, only_target=True)
    assert (only.count("<polyline"), only.count("<text")) == (2, 0)
    assert analysis_marks({"wrinkles": [{"curve": []}]}, window.project) == ""


def test_picture_is_a_figure_with_its_caption_escaped() -> None:
    html = Picture(b"jpeg", 4, 3, "<circle/>").html("a <b>")
    assert base64.b64encode(b"jpeg").decode() in html
    assert "<figcaption>a &lt;b&gt;</figcaption>" in html
    assert re.search(r'<svg viewBox="0 0 4 3"[^>]*><circle/></svg>', html)


# ---------------------------------------------------------------- charts


def test_line_chart_places_values_and_leaves_gaps() -> None:
    chart = line_chart(
        [Series("true", "#123456", [20.0, None, 5.0])], unit="mm", limit=(5.0, "5 mm")
    )
    places = [
        (float(x), float(y)) for x, y in re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)"', chart)
    ]
    assert len(places) == 2
    (x0, y0), (x2, y2) = places
    assert x0 < x2
    assert y0 < y2  # higher values are drawn higher
    line = float(re.findall(r'y1="([\d.]+)"[^>]*stroke="#1b8a3c"', chart)[0])
    assert line == pytest.approx(y2, abs=0.1)
    assert ">true</text>" in chart
    assert re.findall(r"<title>([^<]*)", chart) == [
        "true, after 0 actions: 20.0 mm",
        "true, after 2 actions: 5.0 mm",
    ]


@pytest.mark.parametrize(("least", "most"), [(0.0, 24.0), (80.0, 101.5), (0.0, 0.4), (0.0, 700.0)])
def test_line_chart_has_a_few_round_ticks(least: float, most: float) -> None:
    chart = line_chart([Series("a", "#000000", [least])], unit="", least=least, most=most)
    ticks = [float(t) for t in re.findall(r'text-anchor="end">([^<]*)<', chart)]
    assert 2 <= len(ticks) <= 6
    assert ticks[0] >= least
    assert ticks[-1] <= most
    assert np.ptp(np.diff(ticks)) < 1e-9


def test_stage_chart_is_to_scale() -> None:
    chart = stage_chart(
        [("action 1", {"render": 4.0, "motion": 8.0}), ("action 2", {"motion": 4.0, "nap": 1.0})]
    )
    widths = [float(w) + 1.5 for w in re.findall(r'<rect [^>]*width="([\d.]+)"', chart)]
    np.testing.assert_allclose(np.array(widths) / widths[0], [1.0, 2.0, 1.0, 0.25], rtol=0.02)
    assert "12.0 s</text>" in chart
    assert "motion 12.0 s</span>" in chart
    assert "nap 1.0 s</span>" in chart
    assert "stereo" not in chart


def test_folds_are_drawn_and_said() -> None:
    window = Window(-0.3, 0.3, -1.4, -0.8)
    garment = {
        "table_height": 0.7,
        "borders": [[[0.0, -1.2], [0.1, -1.2], [0.1, -1.1]]],
        "flaps": [{"line": [[-0.1, -1.0], [0.1, -1.0]], "opening": [0.0, 1.0]}],
    }
    marks = analysis_marks({"wrinkles": [], "garment": garment}, window.project)
    assert BORDER in marks and marks.count(FOLD_LINE) >= 2
    only = analysis_marks({"wrinkles": [], "garment": garment}, window.project, only_target=True)
    assert only == ""
