"""Every real capture, from its file to a verified plan, or the reason why there is none."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.data import data_folder
from benchmarks.harness.report import Progress
from unwrinkle.flattening.flattener import Flattener
from unwrinkle.flattening.observation import Observation
from unwrinkle.models.robot import load_cell
from unwrinkle.perception.depth.capture import load_capture

_SETS = (("uc3m_textiles", "*_depth_mm.png"), ("clopema_ctu_spread_garments", "cloD*.png"))
_CAMERA = "xtion-pro-live"
_COLUMNS = (
    "capture",
    "wrinkles",
    "largest: length x width x chord height, mm",
    "halting measure, mm",
    "plan",
    "verdict",
    "perception + planning + verification, s",
    "why not",
    "planned and verified when turned by, deg",
)
#: Turns of the garment on the table that are tried where it has no plan as it lies, degrees.
_TURNS = (180.0, 90.0, -90.0, 135.0, -135.0, 45.0, -45.0)


def run(*, quick: bool, seed: int, progress: Progress) -> dict[str, Any]:
    """Analyse and plan for every capture; every third one if quick."""
    paths = [path for name, pattern in _SETS for path in sorted(data_folder(name).glob(pattern))]
    paths = paths[::3] if quick else paths
    flattener = Flattener(load_cell())
    rows = []
    for done, path in enumerate(paths):
        progress(done, len(paths), path.stem)
        rows.append(_measure(path, flattener, seed))
    planned = [row for row in rows if row["planned"]]
    return {
        "captures": rows,
        "planned": len(planned),
        "planned_when_turned": sum(row.get("turned") is not None for row in rows),
        "flat": sum(row["flat"] for row in rows),
        "verdicts_passed_fraction": float(np.mean([row["passed"] for row in planned])),
        "perception_time_median": float(np.median([row["perception"] for row in rows])),
    }


def _measure(path: Path, flattener: Flattener, seed: int) -> dict[str, Any]:
    clock = time.perf_counter()
    observation = _observation(path, flattener, seed)
    analysis = observation.analysis
    row: dict[str, Any] = {
        "name": path.stem.removesuffix("_depth_mm"),
        "perception": time.perf_counter() - clock,
        "wrinkles": len(analysis.wrinkles),
        "largest": [
            {"length": w.length, "width": w.width, "chord_height": w.chord_height}
            for w in analysis.wrinkles[:3]
        ],
        "halting_measure": analysis.halting_measure,
    }
    row |= _proposed(flattener, observation)
    if not row["planned"] and not row["flat"]:
        row["turned"] = next(
            (
                turn
                for turn in _TURNS
                if _proposed(flattener, _observation(path, flattener, seed, turn))["planned"]
            ),
            None,
        )
    return row


def _observation(path: Path, flattener: Flattener, seed: int, turn: float = 0.0) -> Observation:
    """Observe a capture laid on the table, turned by degrees."""
    return flattener.observe(load_capture(path, _CAMERA), yaw=np.radians(turn), seed=seed)


def _proposed(flattener: Flattener, observation: Observation) -> dict[str, Any]:
    """Return what the flattener proposes, as plain data."""
    clock = time.perf_counter()
    proposal = flattener.propose(observation)
    spent = time.perf_counter() - clock
    row: dict[str, Any] = {
        "flat": proposal.plan is None and proposal.flat,
        "planned": proposal.plan is not None,
        "reason": "; ".join(proposal.refused),
    }
    if proposal.plan is None:
        return row | {"reason": proposal.reason}
    planning = proposal.planned.result.timings.total
    return row | {
        "wrinkle": proposal.choice.decision.wrinkle.index + 1,
        "dual": proposal.plan.dual,
        "pull": proposal.plan.target.hands[0].pull_distance,
        "passed": proposal.verdict.passed,
        "planning": planning,
        "verification": spent - planning,
    }


def table(results: dict[str, Any]) -> str:
    """One row per capture."""
    lines = [
        "Halting measure: the largest pull distance (foot to foot). A garment is flat if that is below 5 mm and no wrinkle is",
        "higher than 4 mm. Garments are laid",
        "with their centre at (0, -1.10) on the 0.8 x 0.8 m table, the image's upper edge away from the robot.",
        "",
        "| " + " | ".join(_COLUMNS) + " |",
        "|" + "---|" * len(_COLUMNS),
    ]
    for row in results["captures"]:
        sizes = [
            f"{1e3 * w['length']:.0f} x {1e3 * w['width']:.0f} x {1e3 * w['chord_height']:.1f}"
            for w in row["largest"][:1]
        ]
        plan, verdict, times = "-", "-", f"{row['perception']:.2f}"
        if row["planned"]:
            plan = f"{'dual' if row['dual'] else 'single'}, wrinkle {row['wrinkle']}"
            verdict = "pass" if row["passed"] else "REFUSED"
            times += f" + {row['planning']:.2f} + {row['verification']:.2f}"
        cells = (
            row["name"],
            str(row["wrinkles"]),
            sizes[0] if sizes else "-",
            f"{1e3 * row['halting_measure']:.1f}",
            plan,
            verdict,
            times,
            row["reason"],
            "" if row["planned"] or row["flat"] else _turn(row["turned"]),
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _turn(turn: float | None) -> str:
    return "none" if turn is None else f"{turn:.0f}"
