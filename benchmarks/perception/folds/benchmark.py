"""`unwrinkle bench folds`: state, flaps and ridges of simulated garments, folded and not, beside
the truth of the cloth.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.harness.report import Progress
from benchmarks.harness.tables import table as table_of
from benchmarks.harness.trials import run_trials, trials_wall
from benchmarks.perception.folds.trials import FoldTrial, trial
from unwrinkle.perception.folds.garment_state import GarmentState
from unwrinkle.perception.folds.ridge_kinds import RidgeKind

_GARMENTS = ("towel", "dishcloth", "tshirt")
#: Starts, and whether their flap is one that opens along a line.
_STARTS = {
    "flat": False,
    "bunched": False,
    "corner": True,
    "edge": True,
    "pressed": True,
    "pushed": False,
    "twice": False,
    "dropped": False,
}
_SENSORS = {"stereo": "stereo head", "depth": "Xtion"}
_SEEDS, _FIRST_SEED = 10, 100


@dataclass(frozen=True, kw_only=True)
class SensorFigures:
    """What one sensor's answers are worth.

    Attributes:
        trials: states that were looked at.
        false_flat, false_flat_unknown: garments called flat that are not, with the flat area known
            and not known.
        state_right_fraction: of the answers with the flat area known; "not seen well enough" apart.
        unseen_fraction: of the answers.
        state_right_unknown_fraction: without the flat area; "wrinkled or folded" is right for both.
        border_taken_fraction: of the ridges that are said to be wrinkles, those that are borders.
        wrinkle_precision: the rest of them.
        wrinkles_kept_fraction: of the ridges that are no border in truth.
        flaps: with one flap in truth; found with the known outline.
        flap_found_fraction, flap_turn_max, flap_turn_median: of their directions, deg.
        flap_area_error_median, flap_area_error_max: shares.
    """

    trials: int
    false_flat: int
    false_flat_unknown: int
    state_right_fraction: float
    unseen_fraction: float
    state_right_unknown_fraction: float
    border_taken_fraction: float
    wrinkle_precision: float
    wrinkles_kept_fraction: float
    flaps: int
    flap_found_fraction: float
    flap_turn_median: float
    flap_turn_max: float
    flap_area_error_median: float
    flap_area_error_max: float
    answers: dict[str, dict[str, int]]


@dataclass(frozen=True, kw_only=True)
class FoldsResult:
    """All sensors, and each trial."""

    trials_wall: float
    sensors: dict[str, SensorFigures]
    runs: tuple[FoldTrial, ...]


#: Rows of the table, and what they show of a sensor.
_ROWS: dict[str, Callable[[SensorFigures], str]] = {
    "states": lambda f: str(f.trials),
    "called flat and not flat: flat area known, not known": lambda f: (
        f"{f.false_flat}, {f.false_flat_unknown}"
    ),
    "state right, flat area known; not seen well enough": lambda f: (
        f"{f.state_right_fraction:.1%}; {f.unseen_fraction:.1%}"
    ),
    "state right, flat area not known": lambda f: f"{f.state_right_unknown_fraction:.1%}",
    "list of wrinkles: precision; true ones kept": lambda f: (
        f"{f.wrinkle_precision:.2f}; {f.wrinkles_kept_fraction:.0%}"
    ),
    "corner, edge and pressed flaps found with the known outline": lambda f: (
        f"{f.flap_found_fraction:.0%} of {f.flaps}"
    ),
    "direction in which they open, error: median, worst": lambda f: (
        f"{f.flap_turn_median:.1f}, {f.flap_turn_max:.1f} deg"
    ),
    "area of the flap, error: median, worst": lambda f: (
        f"{f.flap_area_error_median:.0%}, {f.flap_area_error_max:.0%}"
    ),
}


def run(*, quick: bool, seed: int, progress: Progress) -> FoldsResult:
    """Look at every garment in every start; a towel's from one seed if quick."""
    garments = _GARMENTS[:1] if quick else _GARMENTS
    seeds = range(_FIRST_SEED + seed, _FIRST_SEED + seed + (1 if quick else _SEEDS))
    wanted = [
        trial(garment, start, sensor, number)
        for sensor in _SENSORS
        for garment in garments
        for start in _STARTS
        for number in (seeds if start != "flat" else seeds[:2])
    ]
    rows = run_trials("folds", wanted, FoldTrial, progress)
    return FoldsResult(
        trials_wall=trials_wall(rows),
        sensors={
            sensor: _figures([row for row in rows if row.settings["sensor"] == sensor])
            for sensor in _SENSORS
        },
        runs=tuple(rows),
    )


def _figures(rows: Sequence[FoldTrial]) -> SensorFigures:
    told = [row for row in rows if row.known != GarmentState.UNSEEN]
    right_unknown = [
        row.unknown == row.truth
        or (row.unknown == GarmentState.NOT_FLAT and row.truth != GarmentState.FLAT)
        for row in rows
        if row.unknown != GarmentState.UNSEEN
    ]
    ridges = [ridge for row in rows for ridge in row.ridges]
    taken = [ridge for ridge in ridges if ridge.kind == RidgeKind.WRINKLE]
    real = [ridge for ridge in ridges if not ridge.border]
    flaps = [row for row in rows if _STARTS[row.settings["start"]] and row.flap and not row.failed]
    found = [row for row in flaps if row.found is not None]
    errors = [abs(row.found / row.flap - 1.0) for row in found if row.found is not None]
    turns = [row.turn for row in found if row.turn is not None]
    answers: dict[str, Counter[str]] = {}
    for row in rows:
        answers.setdefault(row.truth, Counter())[row.known] += 1
    return SensorFigures(
        trials=len(rows),
        false_flat=sum(row.known == GarmentState.FLAT != row.truth for row in rows),
        false_flat_unknown=sum(row.unknown == GarmentState.FLAT != row.truth for row in rows),
        state_right_fraction=_share([row.known == row.truth for row in told]),
        unseen_fraction=1.0 - len(told) / len(rows),
        state_right_unknown_fraction=_share(right_unknown),
        border_taken_fraction=_share([ridge.border for ridge in taken]),
        wrinkle_precision=_share([not ridge.border for ridge in taken]),
        wrinkles_kept_fraction=_share([ridge.kind == RidgeKind.WRINKLE for ridge in real]),
        flaps=len(flaps),
        flap_found_fraction=_share([row.found is not None for row in flaps]),
        flap_turn_median=float(np.median(turns)) if turns else 0.0,
        flap_turn_max=max(turns, default=0.0),
        flap_area_error_median=float(np.median(errors)) if errors else 0.0,
        flap_area_error_max=max(errors, default=0.0),
        answers={truth: dict(counts) for truth, counts in answers.items()},
    )


def _share(values: Sequence[bool]) -> float:
    return float(np.mean(values)) if values else 0.0


def table(results: FoldsResult) -> str:
    """Return the results as Markdown."""
    parts = [
        "Simulated towels, dishcloths and T-shirts, folded and not, each from seeds that no threshold was chosen by. Truth is the mesh of the",
        "cloth: *folded* if a region of two layers has 8 cm2 or more, or if all overhangs together have 3 % of the garment; *flat* if 98 %",
        "of it are seen and nothing stands over 5 mm.",
        "",
        table_of(
            ("", *(f"{name} (simulated)" for name in _SENSORS.values())),
            [
                (what, *(show(results.sensors[sensor]) for sensor in _SENSORS))
                for what, show in _ROWS.items()
            ],
        ),
    ]
    for sensor, name in _SENSORS.items():
        answers = results.sensors[sensor].answers
        said = sorted({state for counts in answers.values() for state in counts})
        parts += [
            "",
            f"Answers with the flat area known, {name}:",
            "",
            table_of(
                ("true", *said),
                [
                    (truth, *(str(counts.get(state, 0)) for state in said))
                    for truth, counts in sorted(answers.items())
                ],
            ),
        ]
    return "\n".join(parts) + "\n"
