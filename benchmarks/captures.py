"""Every real capture, from its file to a verified plan, or the reason why there is none."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from unwrinkle.benchmarks._data import GARMENT_CENTRE, TABLE, data_folder
from unwrinkle.benchmarks.report import Progress
from unwrinkle.flattening.verified_planning import plan_verified
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.perception.depth.range_mapping import load_capture, range_map_from_capture
from unwrinkle.perception.target import NoTarget
from unwrinkle.perception.wrinkles.analysis import Analysis, analyse
from unwrinkle.planning.search.planner import FlatteningPlanner

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
    "why not (wrinkle: reason)",
    "planned and verified when turned by, deg",
)
#: Turns of the garment on the table that are tried where it has no plan as it lies, degrees.
_TURNS = (180.0, 90.0, -90.0, 135.0, -135.0, 45.0, -45.0)


def run(*, quick: bool, seed: int, progress: Progress) -> dict[str, Any]:
    """Analyse and plan for every capture; every third one if quick."""
    paths = [path for name, pattern in _SETS for path in sorted(data_folder(name).glob(pattern))]
    paths = paths[::3] if quick else paths
    cell = load_cell()
    planner = FlatteningPlanner(cell)
    rows = []
    for done, path in enumerate(paths):
        progress(done, len(paths), path.stem)
        rows.append(_measure(path, cell, planner, seed))
    planned = [row for row in rows if row["planned"]]
    return {
        "captures": rows,
        "planned": len(planned),
        "planned_when_turned": sum(row.get("turned") is not None for row in rows),
        "flat": sum(row["flat"] for row in rows),
        "verdicts_passed_fraction": float(np.mean([row["passed"] for row in planned])),
        "perception_time_median": float(np.median([row["perception"] for row in rows])),
    }


def _measure(path: Path, cell: Cell, planner: FlatteningPlanner, seed: int) -> dict[str, Any]:
    clock = time.perf_counter()
    analysis = _analysis(path, seed)
    row: dict[str, Any] = {
        "name": path.stem.removesuffix("_depth_mm"),
        "perception": time.perf_counter() - clock,
        "wrinkles": len(analysis.wrinkles),
        "largest": [
            {"length": w.length, "width": w.width, "chord_height": w.chord_height}
            for w in analysis.wrinkles[:3]
        ],
        "halting_measure": analysis.halting_measure,
        "flat": analysis.flat,
        "planned": False,
        "reason": "flat: nothing to pull" if analysis.flat else "",
    }
    if analysis.flat:
        return row
    row |= _planned(analysis, cell, planner)
    if not row["planned"]:
        row["turned"] = next(
            (
                turn
                for turn in _TURNS
                if _planned(_analysis(path, seed, turn), cell, planner).get("passed", False)
            ),
            None,
        )
    return row


def _analysis(path: Path, seed: int, turn: float = 0.0) -> Analysis:
    """Wrinkles of a capture laid on the table, turned by degrees."""
    capture = load_capture(path, _CAMERA)
    return analyse(
        range_map_from_capture(
            capture,
            yaw=np.radians(turn),
            seed=seed,
            centre=GARMENT_CENTRE,
            table_height=TABLE.height,
        ),
        table=TABLE,
    )


def _planned(analysis: Analysis, cell: Cell, planner: FlatteningPlanner) -> dict[str, Any]:
    """The plan for the largest wrinkle that has one, as the command line chooses it."""
    reasons = []
    for index in analysis.worth_pulling:
        target = analysis.target_for(index)
        if isinstance(target, NoTarget):
            reasons.append(f"{index + 1}: {target.reason}")
            continue
        clock = time.perf_counter()
        found = plan_verified(planner, cell, target)
        result, planning = found.result, found.result.timings.total
        if result.plan is None or found.verdict is None:
            reasons.append(f"{index + 1}: {result.failure.message if result.failure else ''}")
            continue
        return {
            "planned": True,
            "wrinkle": index + 1,
            "dual": result.plan.dual,
            "pull": target.hands[0].pull_distance,
            "passed": found.verdict.passed,
            "planning": planning,
            "verification": time.perf_counter() - clock - planning,
            "reason": "; ".join(reasons),
        }
    return {"reason": "; ".join(reasons)}


def table(results: dict[str, Any]) -> str:
    """One row per capture."""
    lines = [
        "Halting measure: the largest pull distance (foot to foot); below 5 mm a garment counts as flat. Garments are laid",
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
