"""The closed loop through the drivers, on devices in real time."""

import dataclasses as dc
import html
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from unwrinkle.cli import app
from unwrinkle.closed_loop.session import Choices, begin_run, resume_run
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import CameraSite, PanTiltSite, Site, loopback_site
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.runs.folder import RunFolder

pytestmark = pytest.mark.alone

SMALL = ["--scale", "0.25", "--no-live"]


@pytest.fixture(scope="module")
def first_look(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run a look without an action; return its folder with the first pair."""
    folder = tmp_path_factory.mktemp("look") / "run"
    result = CliRunner().invoke(app, ["flatten", "--actions", "0", "--out", str(folder), *SMALL])
    assert result.exit_code == 3, result.output
    return folder


@pytest.fixture
def site(first_look: Path, tmp_path: Path) -> Iterator[Site]:
    """Run virtual equipment in real time; its camera returns the first look's pair, once."""
    pairs = tmp_path / "pairs"
    pairs.mkdir()
    for eye in ("left", "right"):
        shutil.copy(first_look / "000" / f"{eye}.png", pairs / f"{eye}0.png")
    command = [sys.executable, "-u", "-m", "unwrinkle", "controller", "--pan-tilt"]
    with subprocess.Popen(
        [*command, "--ports", "0,0,0"], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        said = [process.stdout.readline() for _ in range(3)]
        motion, state, io = map(int, re.findall(r"(?:motion|state|I/O) (\d+)", said[0]))
        units = [line.split(": ")[1].strip() for line in said[1:]]
        reader = threading.Thread(target=process.stdout.read, daemon=True)
        reader.start()
        base = loopback_site()
        ports = {"motion_port": motion, "state_port": state, "io_port": io}
        yield dc.replace(
            base,
            controller=dc.replace(base.controller, **ports),
            pan_tilt=PanTiltSite(*units),
            cameras=CameraSite("folder", folder=str(pairs)),
        )
        process.send_signal(signal.SIGINT)
        reader.join(5.0)


HARDWARE = Choices(station="hardware", scale=0.25, actions=1)


@pytest.mark.slow
@pytest.mark.end_to_end
def test_an_action_on_devices_in_real_time(site: Site, tmp_path: Path) -> None:
    asked: list[tuple[FlatteningPlan, Verdict]] = []

    def approve(plan: FlatteningPlan, verdict: Verdict) -> str:
        asked.append((plan, verdict))
        return ""

    folder = tmp_path / "run"
    ending = begin_run(HARDWARE, None, folder, site=site, approve=approve).run()
    assert ending.status == "stopped" and "nothing usable seen" in ending.reason
    action = RunFolder.open(folder).look(0).action()
    assert action.outcome == "done", action.reason
    assert [plan.content_hash for plan, _ in asked] == [asked[0][1].plan_hash]
    records = read_run_log(folder / "controller-1.jsonl")
    moved = np.abs(records.measured.positions - records.measured.positions[0]).max()
    assert moved > 0.3 and not records.cut
    grips = [event.data["closed"] for event in records.events if event.kind == "gripper"]
    assert grips == [[True, True], [False, False]]
    for page in (
        "report.html",
        "replay.html",
    ):  # nothing was simulated, and the pages must not claim so
        text = html.unescape((folder / page).read_text(encoding="utf-8"))
        assert "site's devices" in text and "are simulated" not in text


@pytest.mark.slow
@pytest.mark.end_to_end
def test_what_the_operator_does_not_confirm_is_not_run(site: Site, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    ending = begin_run(
        HARDWARE, None, folder, site=site, approve=lambda plan, verdict: "not today"
    ).run()
    assert ending.status == "stopped" and "not today" in ending.reason
    records = read_run_log(folder / "controller-1.jsonl")
    assert len(records.commanded.times) == 0


@pytest.mark.parametrize(
    ("change", "approved", "message"),
    [
        ({}, False, "add --go"),
        ({"commissioning": True}, True, "under commissioning"),
        ({"virtual": False}, True, "calibration"),
        ({"cameras": CameraSite("none")}, True, "cameras.kind"),
    ],
)
def test_the_hardware_station_is_refused(
    change: dict[str, object], approved: bool, message: str, tmp_path: Path
) -> None:
    bad = dc.replace(loopback_site(), pan_tilt=PanTiltSite("/dev/null", "/dev/null"), **change)
    folder = tmp_path / "run"
    with pytest.raises(InputError, match=message):
        begin_run(HARDWARE, None, folder, site=bad, approve=(lambda p, v: "") if approved else None)
    assert not folder.exists()  # nothing is left behind


@pytest.mark.parametrize(
    ("text", "form"),
    [
        ("Lab:\n  station: {form: hardware}\n", "hardware"),
        ("Lab:\n  speed: 1.0\n", "sim"),
        ("", "sim"),
        ("{", "sim"),
        ("- a", "sim"),
    ],
)
def test_settings_know_the_stations_form(first_look: Path, text: str, form: str) -> None:
    settings = RunFolder.open(first_look).settings
    assert settings.station == "sim"
    assert dc.replace(settings, scenario=text).station == form


def test_without_a_site_there_is_no_hardware(tmp_path: Path) -> None:
    result = CliRunner().invoke(
        app, ["flatten", "--station", "hardware", "--go", "--out", str(tmp_path / "run"), *SMALL]
    )
    assert isinstance(result.exception, InputError)
    assert "--site" in str(result.exception)


def test_a_run_goes_on_in_its_own_form(first_look: Path) -> None:
    with pytest.raises(InputError, match="--station"):
        resume_run(first_look, Choices(station="loopback"))


def test_plans_are_verified_in_the_sites_own_cell(tmp_path: Path) -> None:
    own, other = tmp_path / "lab.scenario.yaml", tmp_path / "other.scenario.yaml"
    own.write_text("Lab:\n  table: {size: [0.0, 0.8]}\n", encoding="utf-8")
    other.write_text("Other: {}\n", encoding="utf-8")
    site = dc.replace(loopback_site(), scenario=str(own))
    with pytest.raises(InputError, match="leave --scenario out"):
        begin_run(HARDWARE, other, tmp_path / "run", site=site, approve=lambda p, v: "")
    with pytest.raises(InputError, match="table size"):  # its own cell is read, and is invalid
        begin_run(HARDWARE, None, tmp_path / "run", site=site, approve=lambda p, v: "")
    assert not (tmp_path / "run").exists()
