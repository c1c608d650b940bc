"""Files of one look of a run and of the action that followed it."""

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

#: Fastest compression of PNG: an image of 16 megapixels is written between two stages.
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1)


Value = TypeVar("Value")


class Saveable(Protocol):
    """Value that writes itself to a file, such as the cloth's state."""

    def save(self, path: Path) -> None:
        """Write the file atomically."""


class LookFolder:
    """One look at the garment and the action that followed it.

    The files of `RUN/000`, `RUN/001`, ...

    Reading raises InputError with the name of a missing or damaged file.
    """

    def __init__(self, path: Path, index: int) -> None:
        """Keep the path; the folder is created with the first file."""
        self.path = path
        self.index = index

    def save_pair(self, left: NDArray[np.uint8], right: NDArray[np.uint8], gaze: Gaze) -> None:
        """Write both cameras' images (h, w, 3) RGB and the head's angles.

        Raises:
            InputError: a file cannot be written.
        """
        _write_png(self.path / "left.png", left)
        _write_png(self.path / "right.png", right)
        calibration = nominal_calibration()
        # A simulated pair has no date of its own; the calibration's date keeps repeated runs
        # identical.
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
        """Write the analysis with its points, and the decision.

        Args:
            observation: observation of the garment.
            target, wrinkle: chosen target, and the index of its wrinkle.
            stop: decision to stop.

        Raises:
            InputError: the file cannot be written.
        """
        report = analysis_report(
            observation, target=target, wrinkle=wrinkle, stop=stop, points=True
        )
        write_json(self.path / "analysis.json", report)

    def save_plan(self, plan: FlatteningPlan, verdict: Verdict | None = None) -> None:
        """Write the plan and its verdict. Raises InputError if a file cannot be written."""
        plan.save(self.path / "plan.npz")
        if verdict is not None:
            write_json(self.path / "verdict.json", verdict.to_json())

    def save_before(self, state: Saveable) -> None:
        """Write the true state of the cloth before.

        Raises InputError if the file cannot be written.
        """
        self._save_state("before.npz", state)

    def save_after(self, state: Saveable) -> None:
        """Write the true state of the cloth after.

        Raises InputError if the file cannot be written.
        """
        self._save_state("after.npz", state)

    def save_motion(self, motion: MotionRecord) -> None:
        """Write the motion. Raises InputError if the file cannot be written."""
        motion.save(self.path / "motion.npz")

    def save_action(self, action: ActionRecord) -> None:
        """Write `action.json`, which makes the folder complete.

        Raises:
            InputError: the record is of another look, its memory cannot be written as JSON, or the
                file cannot be written.
        """
        if action.index != self.index:
            raise InputError(
                f"{self.path}: is look {self.index}, but the record is of look {action.index}"
            )
        path = self.path / "action.json"
        try:
            write_json(path, action.to_json())
        except (TypeError, ValueError) as error:
            raise InputError(f"{path}: the memory cannot be written as JSON: {error}") from None

    @property
    def exists(self) -> bool:
        """Return whether anything of the look was written."""
        return self.path.is_dir()

    @property
    def is_complete(self) -> bool:
        """Return whether the action was recorded to its end."""
        return (self.path / "action.json").is_file()

    @property
    def after_file(self) -> Path:
        """Return the file of the cloth's state after the action."""
        return self.path / "after.npz"

    def left_picture(self) -> NDArray[np.uint8]:
        """Read the left camera's image (h, w, 3) RGB."""
        return _read_png(self.path / "left.png")

    def right_picture(self) -> NDArray[np.uint8]:
        """Read the right camera's image (h, w, 3) RGB."""
        return _read_png(self.path / "right.png")

    def depth(self) -> Capture:
        """Read the depth camera's capture."""
        return load_capture(self.path / "depth.npz")

    def range_map(self) -> RangeMap:
        """Read the range map."""
        return RangeMap.load(self.path / "range_map.npz")

    def analysis(self) -> dict[str, Any]:
        """Read the analysis as plain data, with the wrinkles' points."""
        path = self.path / "analysis.json"
        data = read_json(path)
        if data.get("format") != "unwrinkle.analysis" or data.get("version") != 1:
            raise InputError(
                f"{path}: is no analysis of version 1; it was written by another version"
            )
        return data

    def plan(self) -> FlatteningPlan:
        """Read the plan."""
        return FlatteningPlan.load(self.path / "plan.npz")

    def verdict(self) -> dict[str, Any]:
        """Read the verdict as plain data."""
        return read_json(self.path / "verdict.json")

    def motion(self) -> MotionRecord:
        """Read the motion."""
        return MotionRecord.load(self.path / "motion.npz")

    def action(self) -> ActionRecord:
        """Read the action's record."""
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
    """Return the result of `read`, or None if the file is missing or damaged."""
    try:
        return read()
    except InputError:
        return None


def read_json(path: Path) -> dict[str, Any]:
    """Read the object in a JSON file.

    Raises:
        InputError: the file is missing or damaged, or holds no object; the message names the file.
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
        raise InputError(f"{path}: is missing, or is no image")
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)
