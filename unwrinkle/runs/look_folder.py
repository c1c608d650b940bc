"""One look of a run and the action that followed it, as files."""

import datetime
import json
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path
from typing import Any, Protocol, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.flattening.flattener import analysis_report
from unwrinkle.flattening.observation import Observation
from unwrinkle.flattening.policy import Stop
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import atomic_path, write_json
from unwrinkle.perception.depth.capture import Capture, load_capture, save_capture
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.perception.stereo.head_file import NOMINAL_HEAD, HeadAngles, nominal_calibration
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.runs.records import ActionRecord, MotionRecord

#: PNG's fastest compression: a full picture of 16 megapixels is written between two stages.
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1)


Value = TypeVar("Value")


class Saveable(Protocol):
    """What can write itself to a file, such as the cloth's state."""

    def save(self, path: Path) -> None:
        """Write it, whole or not at all."""


class LookFolder:
    """One look at the garment and the action that followed it: the files of `RUN/000`, `RUN/001`, ...

    Reading raises InputError for a missing or damaged file, naming it.
    """

    def __init__(self, path: Path, index: int) -> None:
        """Name the folder; it is made when the first file is written."""
        self.path = path
        self.index = index

    # ------------------------------------------------------------ writing

    def save_pair(self, left: NDArray[np.uint8], right: NDArray[np.uint8], gaze: Gaze) -> None:
        """Write both eyes' pictures (h, w, 3 RGB) and the angles they were taken at.

        Raises:
            InputError: a file cannot be written.
        """
        _write_png(self.path / "left.png", left)
        _write_png(self.path / "right.png", right)
        calibration = nominal_calibration()
        # A simulated pair has no date of its own; the calibration's keeps the same run the same.
        day = datetime.date.fromisoformat(calibration.date)
        file = f"package://unwrinkle_models/heads/{NOMINAL_HEAD}.yaml"
        plain = Gaze(*(float(angle) for angle in astuple(gaze)))
        HeadAngles.of(plain, calibration, file, day).save(self.path / "head.yaml")

    def save_depth(self, capture: Capture) -> None:
        """Write a depth camera's capture.

        Raises:
            InputError: the file cannot be written.
        """
        save_capture(self.path / "depth.npz", capture, depth_unit=1e-4)

    def save_range_map(self, range_map: RangeMap) -> None:
        """Write the range map. Raises InputError if the file cannot be written."""
        range_map.save(self.path / "range_map.npz")

    def save_analysis(
        self,
        observation: Observation,
        *,
        target: FlatteningTarget | None = None,
        wrinkle: int | None = None,
        stop: Stop | None = None,
    ) -> None:
        """Write the analysis with its points, and what was decided on it.

        Args:
            observation: of the garment.
            target, wrinkle: that was chosen, and the index of its wrinkle.
            stop: decision to stop.

        Raises:
            InputError: the file cannot be written.
        """
        report = analysis_report(
            observation, target=target, wrinkle=wrinkle, stop=stop, points=True
        )
        write_json(self.path / "analysis.json", report)

    def save_plan(self, plan: FlatteningPlan, verdict: Verdict | None = None) -> None:
        """Write the plan and what its verification said. Raises InputError if a file cannot be written."""
        plan.save(self.path / "plan.npz")
        if verdict is not None:
            write_json(self.path / "verdict.json", verdict.to_json())

    def save_before(self, state: Saveable) -> None:
        """Write the cloth as it truly lay before. Raises InputError if the file cannot be written."""
        self._save_state("before.npz", state)

    def save_after(self, state: Saveable) -> None:
        """Write the cloth as it truly lay after. Raises InputError if the file cannot be written."""
        self._save_state("after.npz", state)

    def save_motion(self, motion: MotionRecord) -> None:
        """Write the motion. Raises InputError if the file cannot be written."""
        motion.save(self.path / "motion.npz")

    def save_action(self, action: ActionRecord) -> None:
        """Write `action.json`, by which the folder is complete.

        Raises:
            InputError: the record is of another look, its memory has no form in JSON, or it cannot be written.
        """
        if action.index != self.index:
            raise InputError(f"{self.path}: is look {self.index}, the record is of {action.index}")
        path = self.path / "action.json"
        try:
            write_json(path, action.to_json())
        except (TypeError, ValueError) as error:
            raise InputError(f"{path}: memory has no form in JSON: {error}") from None

    # ------------------------------------------------------------ reading

    @property
    def exists(self) -> bool:
        """Whether anything of the look was written."""
        return self.path.is_dir()

    @property
    def is_complete(self) -> bool:
        """Whether the action was recorded to its end."""
        return (self.path / "action.json").is_file()

    @property
    def after_file(self) -> Path:
        """Where the cloth's state after the action is."""
        return self.path / "after.npz"

    def left_picture(self) -> NDArray[np.uint8]:
        """The left eye's picture (h, w, 3) RGB."""
        return _read_png(self.path / "left.png")

    def right_picture(self) -> NDArray[np.uint8]:
        """The right eye's picture (h, w, 3) RGB."""
        return _read_png(self.path / "right.png")

    def depth(self) -> Capture:
        """The depth camera's capture."""
        return load_capture(self.path / "depth.npz")

    def range_map(self) -> RangeMap:
        """The range map."""
        return RangeMap.load(self.path / "range_map.npz")

    def analysis(self) -> dict[str, Any]:
        """The analysis as plain data, with the wrinkles' points."""
        path = self.path / "analysis.json"
        data = read_json(path)
        if data.get("format") != "unwrinkle.analysis" or data.get("version") != 1:
            raise InputError(f"{path}: is no analysis of version 1")
        return data

    def plan(self) -> FlatteningPlan:
        """The plan."""
        return FlatteningPlan.load(self.path / "plan.npz")

    def verdict(self) -> dict[str, Any]:
        """The verdict as plain data."""
        return read_json(self.path / "verdict.json")

    def motion(self) -> MotionRecord:
        """The motion."""
        return MotionRecord.load(self.path / "motion.npz")

    def action(self) -> ActionRecord:
        """The action's record."""
        path = self.path / "action.json"
        data = read_json(path)
        try:
            return ActionRecord.from_json(data)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def _save_state(self, name: str, state: Saveable) -> None:
        path = self.path / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            state.save(path)
        except OSError as error:
            raise InputError(f"cannot write {path}: {error}; name a writable file") from None


def readable(read: Callable[[], Value]) -> Value | None:
    """What `read` gives, or None where the file is missing or damaged."""
    try:
        return read()
    except InputError:
        return None


def read_json(path: Path) -> dict[str, Any]:
    """The object in a JSON file.

    Raises:
        InputError: missing, damaged, or no object; the message names the file.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as JSON: {error}") from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: holds no JSON object")
    return data


def _write_png(path: Path, picture: NDArray[np.uint8]) -> None:
    done, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), _PNG)
    if not done:
        raise InputError(f"{path}: the picture cannot be encoded")
    with atomic_path(path) as temporary:
        temporary.write_bytes(data.tobytes())


def _read_png(path: Path) -> NDArray[np.uint8]:
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
    if picture is None:
        raise InputError(f"{path}: missing, or no picture")
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)
