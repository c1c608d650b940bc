"""`unwrinkle bench calibration`: how well cameras, stereo pair and head are calibrated from
nothing.

Three parts: real chessboards photographed by others; corners with known noise at many random heads;
and the rendered cell, where a head that differs from the nominal one is calibrated from photographs
alone (4928 x 3264, distorted, blurred, noisy): a board at 20 places for the stereo pair, then a
fixed board from 20 gazes. Its range maps at new gazes are compared with those of the true head.
"""

import logging
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.harness.data import data_folder
from benchmarks.harness.report import Progress
from benchmarks.harness.tables import line, rule
from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import load_cell
from unwrinkle.models.transforms import inverse, pose
from unwrinkle.perception.calibration.boards import Board
from unwrinkle.perception.calibration.files import find_board_pairs, find_pairs
from unwrinkle.perception.calibration.hand_eye import angle_between
from unwrinkle.perception.calibration.head import HeadFit
from unwrinkle.perception.calibration.stereo import calibrate_stereo
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.perception.stereo.range_mapping import range_map_from_pair
from unwrinkle.simulation.devices.pan_tilt import REPEATABILITY
from unwrinkle.simulation.rendering.boards import chessboard
from unwrinkle.simulation.rendering.image_noise import photograph_pair
from unwrinkle.simulation.rendering.meshes import towel_mesh
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import Towel, wrinkled_towel
from unwrinkle.testing.calibration_scene import (
    BOARD,
    BoardScene,
    Units,
    corners_of,
    photographs_of,
    scaled_head,
    true_head,
)
from unwrinkle.testing.table import TABLE

_REAL = "stereo_chessboard"
_CORNER_NOISE = 0.04  # pixels along either axis: what photographs of the board have
_AWAY = pose(np.eye(3), np.array([0.0, 30.0, 0.0]))
_RIM = 0.006
_QUICK_SCALE = 0.25
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ChessboardFigures:
    """Real chessboards, calibrated.

    Attributes:
        pairs: found.
        rms_px, row_error_px: px.
        focal_px: of left and right, x and y; focal_sigma_px: their deviations.
        focal_owner_px: as the owner has it; focal_difference_max: relative.
        time: s.
    """

    pairs: int
    rms_px: float
    row_error_px: float
    focal_px: tuple[float, ...]
    focal_sigma_px: tuple[float, ...]
    focal_owner_px: float
    focal_difference_max: float
    time: float


@dataclass(frozen=True)
class EyeErrors:
    """Errors of one eye: turns in rad, shifts in m, of its mount by us and by Tsai-Lenz alone."""

    turn: float
    shift: float
    tsai_turn: float
    tsai_shift: float
    turn_sigma: float
    shift_sigma: float
    focal_error: float
    centre_error_px: float


@dataclass(frozen=True, kw_only=True)
class HeadErrors:
    """How far a calibration is from the truth, and what it says of itself; rad, m.

    Attributes:
        eyes: left and right.
        base_turn, base_shift: of the right base.
        joint_noise, rms_px, row_error_px: of the adjustment.
    """

    eyes: tuple[EyeErrors, ...]
    base_turn: float
    base_shift: float
    joint_noise: float
    rms_px: float
    row_error_px: float


@dataclass(frozen=True, kw_only=True)
class SyntheticHead(HeadErrors):
    """A head calibrated from corners with known noise; repeatability of the units in steps."""

    seed: int
    repeatability: float


@dataclass(frozen=True, kw_only=True)
class RenderedHead(HeadErrors):
    """A head calibrated from photographs in the rendered cell."""

    repeatability: float
    pairs: int
    stereo_rms_px: float
    corner_error_px: float
    rejected: tuple[str, ...]


@dataclass(frozen=True)
class RangeMapErrors:
    """RMS of height at a gaze, rad, by the head found and by the true one, m."""

    gaze: tuple[float, ...]
    rms: float
    rms_true: float


@dataclass(frozen=True)
class CalibrationResult:
    """Real chessboards, synthetic corners, and the rendered cell.

    Attributes:
        corner_noise_px: of the synthetic corners.
        repeatability: of the units, steps.
        real: None where the data is not at hand.
        synthetic, rendered: heads.
        range_maps: at new gazes.
        mount_turn_error, mount_shift_error: of the first rendered head, rad, m.
        range_map_ratio_max: of errors with the head found over those with the true one.
    """

    corner_noise_px: float
    repeatability: float
    real: ChessboardFigures | None
    synthetic: tuple[SyntheticHead, ...]
    rendered: tuple[RenderedHead, ...]
    range_maps: tuple[RangeMapErrors, ...]
    mount_turn_error: float
    mount_shift_error: float
    range_map_ratio_max: float | None = None


def run(*, quick: bool, seed: int, progress: Progress) -> CalibrationResult:
    """Measure. Angles in radians, lengths in metres, pixels where the name says so."""
    heads = 3 if quick else 10
    real = chessboards()
    synthetic = tuple(
        _synthetic(seed + number, repeatability, progress, done)
        for done, (number, repeatability) in enumerate(
            (n, r) for n in range(heads) for r in (0.0, REPEATABILITY)
        )
    )
    _log.info("synthetic: %s", synthetic)
    scene = _RenderedCell(seed, quick)
    rendered = scene.calibrations(progress)
    range_maps = () if quick else scene.range_maps(progress)
    progress(1, 1, "done")
    return CalibrationResult(
        corner_noise_px=_CORNER_NOISE,
        repeatability=REPEATABILITY,
        real=real,
        synthetic=synthetic,
        rendered=rendered,
        range_maps=range_maps,
        mount_turn_error=max(eye.turn for eye in rendered[0].eyes),
        mount_shift_error=max(eye.shift for eye in rendered[0].eyes),
        range_map_ratio_max=max((row.rms / row.rms_true for row in range_maps), default=None),
    )


def chessboards() -> ChessboardFigures | None:
    """The chessboards of others, by the command's own way; None where they are not here."""
    try:
        folder = data_folder(_REAL)
    except InputError:
        return None
    owner = [
        float(f) for f in re.findall(r"data: \[ (\S+),", (folder / "intrinsics.yml").read_text())
    ]
    board = Board(9, 6, 0.025)
    start = time.perf_counter()
    views, missing = find_board_pairs(find_pairs([folder]), board)
    found = calibrate_stereo(views, board, not_found=missing).calibration
    taken = time.perf_counter() - start
    focal = [f for c in (found.left, found.right) for f in (c.fx, c.fy)]
    return ChessboardFigures(
        pairs=len(found.views),
        rms_px=found.rms,
        row_error_px=found.row_error,
        focal_px=tuple(focal),
        focal_sigma_px=tuple(found.focal_sigma),
        focal_owner_px=owner[0],
        focal_difference_max=max(abs(f / owner[0] - 1.0) for f in focal),
        time=taken,
    )


def _synthetic(number: int, repeatability: float, progress: Progress, done: int) -> SyntheticHead:
    progress(done, 0, "synthetic corners")
    rng = np.random.default_rng(number)
    nominal = nominal_calibration()
    truth = true_head(nominal.stereo_head(), rng)
    looks = BoardScene(truth, corners_of(truth, BOARD, _CORNER_NOISE, rng), rng, 20, 20)
    pairs = looks.pairs()
    stereo = calibrate_stereo(pairs, BOARD).calibration
    fit = looks.calibrated(stereo, nominal, repeatability, number)
    return SyntheticHead(seed=number, repeatability=repeatability, **vars(_errors(truth, fit)))


class _RenderedCell:
    """The cell with a board and a towel, and a head that is to be calibrated in it."""

    def __init__(self, seed: int, quick: bool) -> None:
        self.seed = seed
        self.rng = np.random.default_rng(seed)
        nominal = nominal_calibration()
        scale = _QUICK_SCALE if quick else 1.0
        head = scaled_head(nominal.stereo_head(), scale)
        self.nominal = nominal.with_head(head)
        self.truth = true_head(head, self.rng)
        texel = 0.0002 / scale
        squares = (BOARD.columns + 1, BOARD.rows + 1)
        board = chessboard(*squares, BOARD.square, texel=texel)
        self.board = board.mesh.name
        self.towel = wrinkled_towel(seed)
        items = [board.mesh] if quick else [board.mesh, towel_mesh(self.towel, kind="terry")]
        self.renderer = Renderer(load_cell(), items)
        eyes = photographs_of(self.truth, self.renderer, board, BOARD, seed)
        places, looks = (12, 12) if quick else (20, 20)
        self.looks = BoardScene(self.truth, eyes, self.rng, places, looks)
        self.spreads = (0.0,) if quick else (0.0, REPEATABILITY)
        self.fit: HeadFit | None = None

    def calibrations(self, progress: Progress) -> tuple[RenderedHead, ...]:
        """Calibrate from photographs, once for each repeatability of the units."""
        pairs = self.looks.pairs(progress)
        start = time.perf_counter()
        fit = calibrate_stereo(pairs, BOARD)
        taken = time.perf_counter() - start
        found, rows = fit.calibration, []
        _log.info("rendered: %d pairs, RMS %.4f px, %.1f s", len(pairs), found.rms, taken)
        for repeatability in self.spreads:
            start = time.perf_counter()
            self.fit = self.looks.calibrated(
                found, self.nominal, repeatability, self.seed, progress
            )
            row = RenderedHead(
                repeatability=repeatability,
                pairs=len(found.views),
                stereo_rms_px=found.rms,
                corner_error_px=float(
                    np.sqrt(np.mean(np.concatenate(self.looks.corner_errors) ** 2))
                ),
                rejected=(*found.rejected, *self.fit.rejected),
                **vars(_errors(self.truth, self.fit)),
            )
            _log.info("rendered: %s", row)
            rows.append(row)
        return tuple(rows)

    def range_maps(self, progress: Progress) -> tuple[RangeMapErrors, ...]:
        """Range maps of the towel at new gazes, by the head found and by the true one."""
        assert self.fit is not None
        found = self.fit.calibration.stereo_head()
        units = Units.of(self.truth, self.spreads[-1], self.seed + 1)
        self.renderer.move(self.board, _AWAY)
        step, rows = self.truth.left.unit.step, []
        for number in range(5):
            progress(number, 5, "range maps")
            aim = np.array([*self.towel.centre, 0.71]) + self.rng.uniform(-0.08, 0.08, 3)
            aimed = self.truth.gaze_at(aim)
            angles = np.rint(np.array([*aimed.left, *aimed.right]) / step) * step
            gaze = type(aimed)(*(float(angle) for angle in angles))
            X_WL, X_WR = self.truth.poses(units.go(gaze))
            eyes = (self.truth.left.camera, X_WL, self.truth.right.camera, X_WR)
            left, right = photograph_pair(self.renderer, eyes, self.seed + number)
            pair = StereoPair(left, right, f"gaze {number}")
            rms, rms_true = (
                _height_error(pair, head, gaze, self.towel) for head in (found, self.truth)
            )
            rows.append(RangeMapErrors(tuple(angles.tolist()), rms, rms_true))
            _log.info("range map: %s", rows[-1])
        return tuple(rows)


def _height_error(pair: StereoPair, head: StereoHead, gaze: Any, towel: Towel) -> float:
    """RMS error of the height of the towel, off its rim, metres."""
    found = range_map_from_pair(pair, head, gaze, table=TABLE)
    rows, columns = np.indices(found.height.shape)
    x = found.origin[0] + found.resolution * columns
    y = found.origin[1] + found.resolution * rows
    cloth = found.valid & (towel.edge_distance(x, y) > _RIM)
    return float(np.sqrt(np.mean((found.height - towel.height(x, y))[cloth] ** 2)))


def _errors(truth: StereoHead, fit: HeadFit) -> HeadErrors:
    """How far the calibration is from the truth, eye by eye, and what it says of itself."""
    found = fit.calibration.stereo_head()
    rows = []
    for eye, (true, mine) in enumerate(((truth.left, found.left), (truth.right, found.right))):
        turn, shift = _apart(true.X_MC, mine.X_MC)
        tsai_turn, tsai_shift = _apart(true.X_MC, fit.hand_eyes[eye].X_MC)
        sigma = fit.adjustment.mount_sigma[eye]
        rows.append(
            EyeErrors(
                turn=turn,
                shift=shift,
                tsai_turn=tsai_turn,
                tsai_shift=tsai_shift,
                turn_sigma=float(np.linalg.norm(sigma[3:])),
                shift_sigma=float(np.linalg.norm(sigma[:3])),
                focal_error=abs(mine.camera.fx / true.camera.fx - 1.0),
                centre_error_px=float(
                    np.hypot(mine.camera.cx - true.camera.cx, mine.camera.cy - true.camera.cy)
                ),
            )
        )
    between = (inverse(head.left.X_RB) @ head.right.X_RB for head in (truth, found))
    base_turn, base_shift = _apart(*between)
    return HeadErrors(
        eyes=tuple(rows),
        base_turn=base_turn,
        base_shift=base_shift,
        joint_noise=fit.adjustment.joint_noise,
        rms_px=fit.adjustment.rms,
        row_error_px=fit.calibration.row_residual,
    )


def _apart(X: Pose, Y: Pose) -> tuple[float, float]:
    return angle_between(X, Y), float(np.linalg.norm(X[:3, 3] - Y[:3, 3]))


def table(results: CalibrationResult) -> str:
    """Return the three parts as Markdown."""
    lines = []
    real = results.real
    if real is not None:
        lines += [
            (
                f"Real chessboards ({real.pairs} pairs of 640 x 512, found and calibrated in "
                f"{real.time:.1f} s): stereo RMS {real.rms_px:.3f} px, rows "
                f"{real.row_error_px:.3f} px RMS apart after rectification, focal lengths within "
                f"{real.focal_difference_max:.2%} of the owner's (one sigma of ours "
                f"{max(real.focal_sigma_px) / real.focal_owner_px:.2%})."
            ),
            "",
        ]
    lines += [
        "The head from nothing: a board at some places, then a fixed board from some gazes. The",
        "larger error of both eyes; `repeatability` is that of the pan-tilt units, in their steps.",
        "",
        line(
            "corners",
            "repeatability",
            "camera on mount",
            "Tsai-Lenz alone",
            "right base",
            "focal",
            "RMS",
        ),
        rule(7),
    ]
    synthetic = results.synthetic
    for spread in dict.fromkeys(row.repeatability for row in synthetic):
        rows = [row for row in synthetic if row.repeatability == spread]
        label = f"{results.corner_noise_px} px noise, {len(rows)} heads, median (worst)"
        lines.append(_line(label, spread, rows))
    for row in results.rendered:
        label = f"photographs, {row.corner_error_px:.3f} px RMS from truth"
        lines.append(_line(label, row.repeatability, [row]))
    if results.range_maps:
        lines += [
            "",
            "Range maps of a wrinkled towel at new gazes (RMS of height, mm):",
            "",
            line("gaze", "calibrated", "true head", "ratio"),
            rule(4),
        ]
        lines += [
            line(
                f"{number + 1}",
                f"{1e3 * row.rms:.3f}",
                f"{1e3 * row.rms_true:.3f}",
                f"{row.rms / row.rms_true:.2f}",
            )
            for number, row in enumerate(results.range_maps)
        ]
    return "\n".join([*lines, ""])


def _line(label: str, repeatability: float, rows: Sequence[SyntheticHead | RenderedHead]) -> str:
    def pair(turn: str, shift: str) -> str:
        turns = [1e3 * np.degrees(max(getattr(eye, turn) for eye in row.eyes)) for row in rows]
        shifts = [1e3 * max(getattr(eye, shift) for eye in row.eyes) for row in rows]
        return f"{_figure(turns, 1)} mdeg, {_figure(shifts, 2)} mm"

    base = (
        f"{_figure([1e3 * np.degrees(row.base_turn) for row in rows], 1)} mdeg, "
        f"{_figure([1e3 * row.base_shift for row in rows], 2)} mm"
    )
    focal = _figure([1e6 * max(eye.focal_error for eye in row.eyes) for row in rows], 0)
    rms = _figure([row.rms_px for row in rows], 3)
    return line(
        f"{label}",
        f"{repeatability}",
        f"{pair('turn', 'shift')}",
        f"{pair('tsai_turn', 'tsai_shift')}",
        f"{base}",
        f"{focal} ppm",
        f"{rms} px",
    )


def _figure(values: list[float], digits: int) -> str:
    middle = f"{np.median(values):.{digits}f}"
    return middle if len(values) == 1 else f"{middle} ({max(values):.{digits}f})"
