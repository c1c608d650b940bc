"""Every real capture, from its file to a verified plan, or the reason why there is none."""

import dataclasses
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.harness.data import data_folder
from benchmarks.harness.report import Progress
from benchmarks.harness.tables import table as table_of
from benchmarks.perception.capture_labels import CaptureLabels, capture_labels
from unwrinkle.flattening.flattener import Flattener
from unwrinkle.flattening.observation import Observation
from unwrinkle.models.robot import load_cell
from unwrinkle.perception.depth.capture import load_capture
from unwrinkle.perception.folds.garment_state import GarmentState
from unwrinkle.perception.folds.ridge_kinds import RidgeKind

_SETS = (
    "uc3m_textiles/*_depth_mm.png",
    "folded_captures/uc3m/*_depth_mm.png",
    "folded_captures/trtm/*.npz",
    "clopema_ctu_spread_garments/cloD*.png",
)
_CAMERA = "xtion-pro-live"
_COLUMNS = (
    "capture",
    "state by eye",
    "state found",
    "wrinkles",
    "first three, by eye",
    "largest: length x width x chord height, mm",
    "halting measure, mm",
    "plan",
    "verdict",
    "perception + planning + verification, s",
    "why not",
    "planned and verified when turned by, deg",
)
#: Label of a ridge that is a wrinkle.
_WRINKLE = "wrinkle"
#: Turns of the garment on the table that are tried where it has no plan as it lies, degrees.
_TURNS = (180.0, 90.0, -90.0, 135.0, -135.0, 45.0, -45.0)


@dataclass(frozen=True)
class WrinkleSize:
    """Length, width and chord height of a wrinkle, m."""

    length: float
    width: float
    chord_height: float


@dataclass(frozen=True, kw_only=True)
class CaptureFigures:
    """One capture; without a plan the values from `wrinkle` on are empty.

    Attributes:
        name: of the file.
        label: state of the garment by eye; state: that was found, by layers and heights.
        first: what the first three wrinkles are by eye; empty where a wrinkle was not judged.
        perception: time, s.
        wrinkles: found; largest: sizes of three.
        halting_measure: m.
        flat, planned, reason: what the flattener proposes.
        turned: turn of the garment with which there is a plan, degrees.
        wrinkle: that is pulled, from 1.
        pulled: what it is by eye; empty if it was not judged.
        on_flap: whether a hand grasps a flap, which lies on other cloth.
        dual: with both arms.
        pull: distance of the first hand, m.
        passed: the verdict.
        planning, verification: times, s.
    """

    name: str
    label: str
    state: str
    first: tuple[str, ...]
    perception: float
    wrinkles: int
    largest: tuple[WrinkleSize, ...]
    halting_measure: float
    flat: bool = False
    planned: bool = False
    reason: str = ""
    turned: float | None = None
    wrinkle: int | None = None
    pulled: str = ""
    on_flap: bool = False
    dual: bool = False
    pull: float | None = None
    passed: bool = False
    planning: float = 0.0
    verification: float = 0.0


@dataclass(frozen=True)
class CapturesResult:
    """Every real capture.

    Attributes:
        captures: one by one.
        planned, planned_when_turned, flat: how many.
        false_flat: called flat, and are not by eye.
        top3_real_fraction: of the first three wrinkles of each capture, of those that were judged.
        top3_judged: how many that were.
        plans_on_border_or_stack: plans that pull what is no wrinkle, or grasp a flap.
        verdicts_passed_fraction: of the plans.
        perception_time_median: s.
    """

    captures: tuple[CaptureFigures, ...]
    planned: int
    planned_when_turned: int
    flat: int
    false_flat: int
    top3_real_fraction: float
    top3_judged: int
    plans_on_border_or_stack: int
    verdicts_passed_fraction: float
    perception_time_median: float


def run(*, quick: bool, seed: int, progress: Progress) -> CapturesResult:
    """Analyse and plan for every capture; every third one if quick."""
    root = data_folder(_SETS[0].partition("/")[0]).parent
    paths = [path for pattern in _SETS for path in sorted(root.glob(pattern))]
    paths = paths[::3] if quick else paths
    flattener = Flattener(load_cell())
    found = []
    for done, path in enumerate(paths):
        progress(done, len(paths), path.stem)
        labels = capture_labels()[path.relative_to(root).as_posix()]
        found.append(_measure(path, labels, flattener, seed))
    judged = [what for each in found for what in each.first if what]
    planned = [each for each in found if each.planned]
    return CapturesResult(
        captures=tuple(found),
        planned=len(planned),
        planned_when_turned=sum(each.turned is not None for each in found),
        flat=sum(each.flat for each in found),
        false_flat=sum(each.flat and each.label != GarmentState.FLAT for each in found),
        top3_real_fraction=float(np.mean([what == _WRINKLE for what in judged])),
        top3_judged=len(judged),
        plans_on_border_or_stack=sum(
            each.on_flap or each.pulled not in ("", _WRINKLE) for each in planned
        ),
        verdicts_passed_fraction=float(np.mean([each.passed for each in planned])),
        perception_time_median=float(np.median([each.perception for each in found])),
    )


def _measure(path: Path, labels: CaptureLabels, flattener: Flattener, seed: int) -> CaptureFigures:
    clock = time.perf_counter()
    observation = _observation(path, flattener, seed)
    analysis = observation.analysis
    seen = CaptureFigures(
        name=path.stem.removesuffix("_depth_mm"),
        label=labels.state,
        state=observation.folds.state,
        first=tuple(
            labels.of(wrinkle) or ""
            for wrinkle, kind in zip(
                analysis.wrinkles[:3], observation.folds.kinds[:3], strict=True
            )
            if kind is RidgeKind.WRINKLE
        ),
        perception=time.perf_counter() - clock,
        wrinkles=len(analysis.wrinkles),
        largest=tuple(
            WrinkleSize(w.length, w.width, w.chord_height) for w in analysis.wrinkles[:3]
        ),
        halting_measure=analysis.halting_measure,
    )
    found = _proposed(seen, labels, flattener, observation)
    if found.planned or found.flat:
        return found
    turned = next(
        (
            turn
            for turn in _TURNS
            if _proposed(seen, labels, flattener, _observation(path, flattener, seed, turn)).planned
        ),
        None,
    )
    return dataclasses.replace(found, turned=turned)


def _observation(path: Path, flattener: Flattener, seed: int, turn: float = 0.0) -> Observation:
    """Observe a capture laid on the table, turned by degrees."""
    camera = _CAMERA if path.suffix == ".png" else None
    return flattener.observe(load_capture(path, camera), yaw=np.radians(turn), seed=seed)


def _proposed(
    seen: CaptureFigures, labels: CaptureLabels, flattener: Flattener, observation: Observation
) -> CaptureFigures:
    """Add what the flattener proposes; the labels hold for a garment that was not turned."""
    clock = time.perf_counter()
    proposal = flattener.propose(observation)
    spent = time.perf_counter() - clock
    if proposal.plan is None:
        return dataclasses.replace(seen, flat=proposal.flat, reason=proposal.reason)
    planning = proposal.planned.result.timings.total
    return dataclasses.replace(
        seen,
        planned=True,
        reason="; ".join(proposal.refused),
        wrinkle=proposal.choice.decision.wrinkle.index + 1,
        pulled=labels.of(observation.analysis.wrinkles[proposal.choice.decision.wrinkle.index])
        or "",
        on_flap=any(labels.on_flap(hand.p_WG[:2]) for hand in proposal.plan.target.hands),
        dual=proposal.plan.dual,
        pull=proposal.plan.target.hands[0].pull_distance,
        passed=proposal.verdict.passed,
        planning=planning,
        verification=spent - planning,
    )


def table(results: CapturesResult) -> str:
    """Return a line per capture."""
    lines = [
        f"Called flat, and not flat by eye: {results.false_flat}. Of the first three wrinkles of each capture {results.top3_judged} were judged by eye;",
        f"{results.top3_real_fraction:.0%} of them are wrinkles, the others borders of layers, bulges of stacks or noise. Plans that pull one of those or",
        f"grasp a flap: {results.plans_on_border_or_stack} of {results.planned}. One person judged, to about 10 mm.",
        "",
        "Halting measure: the largest pull distance (foot to foot) of any ridge. Garments are laid",
        "with their centre at (0, -1.10) on the 0.8 x 0.8 m table, the image's upper edge away from the robot.",
        "",
        table_of(_COLUMNS, [_cells(each) for each in results.captures]),
    ]
    return "\n".join(lines) + "\n"


def _cells(each: CaptureFigures) -> tuple[str, ...]:
    """Return the line of a capture."""
    sizes = [
        f"{1e3 * w.length:.0f} x {1e3 * w.width:.0f} x {1e3 * w.chord_height:.1f}"
        for w in each.largest[:1]
    ]
    plan, verdict, times = "-", "-", f"{each.perception:.2f}"
    if each.planned:
        plan = f"{'dual' if each.dual else 'single'}, wrinkle {each.wrinkle}: {each.pulled or 'not judged'}"
        plan += ", on a flap" if each.on_flap else ""
        verdict = "pass" if each.passed else "REFUSED"
        times += f" + {each.planning:.2f} + {each.verification:.2f}"
    return (
        each.name,
        each.label,
        each.state,
        str(each.wrinkles),
        ", ".join(what or "not judged" for what in each.first) or "-",
        sizes[0] if sizes else "-",
        f"{1e3 * each.halting_measure:.1f}",
        plan,
        verdict,
        times,
        each.reason,
        "" if each.planned or each.flat else _turn(each.turned),
    )


def _turn(turn: float | None) -> str:
    return "none" if turn is None else f"{turn:.0f}"
