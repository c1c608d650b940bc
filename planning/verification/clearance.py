"""Clearances between bodies, at the samples and between them.

For every pair of bodies a motion bound S(t) is accumulated: S(t1) - S(t0) is at least the relative
displacement of any two of their points from t0 to t1 (see `speed_bounds`), so the distance of the
pair changes by no more than that. If the distance is at least d0 at t0 and d1 at t1, it is at any
time in between at least (d0 + d1 - (S(t1) - S(t0))) / 2. Distances are bounded from below at a few
samples first (see `shapes`). An interval whose bound is below the required distance is halved, down
into the cubic between two samples if necessary.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import QueryObject

from unwrinkle.models.arrays import Array, Indices, Mask
from unwrinkle.planning.verification.model import BodyPair, CellModel
from unwrinkle.planning.verification.motion import Leg
from unwrinkle.planning.verification.shapes import face_gaps, measure
from unwrinkle.planning.verification.speed_bounds import distances_to_axes, speed_bounds
from unwrinkle.planning.verification.verdict import NEAR_BY_DESIGN, Findings, PairClearance

#: Shapes whose lower bound exceeds this are not measured, m.
MEASURED_BELOW = 0.150
#: Greatest relative displacement of any pair between two neighbouring first times, m.
FIRST_STEP = 0.080
#: Shortfall of the required distance that is tolerated between two samples, m; contact never is.
SHORTFALL_BETWEEN_SAMPLES = 1e-3
#: Error of a measured distance, m.
MEASUREMENT_ERROR = 1e-5
#: Penetration of a finger into the working table that is tolerated in a contact window, m.
CONTACT_DEPTH = 1e-4
#: A pair nearer than this to its required distance is refined until the lower bound and the
#: smallest distance found differ by no more than REFINED_SHARE of that distance, limited to the
#: interval REFINED, m.
REFINED_WITHIN = 0.030
REFINED_SHARE = 0.3
REFINED = (2e-3, 5e-3)
#: A shape pair is measured only if its bound is below the smallest distance (or margin) found so
#: far by more than this, m, or below what is required.
LEAST_GAIN = 1e-4
#: Intervals are not halved below this, s.
SHORTEST_INTERVAL = 2e-5
#: Limits of the work for one motion: distances of shapes that are bounded, and distances that are
#: measured. Plans of the benchmark need up to 340 000 and 540.
MOST_BOUNDED = 3_000_000
MOST_MEASURED = 10_000
#: Distances that are bounded in one call, which limits the memory.
BLOCK = 200_000


@dataclass(frozen=True, eq=False)
class _Open:
    """Intervals of time in which the bounds of pairs of shapes are still too low, (m,) each.

    Attributes:
        begin: s on the plan's clock.
        end: s on the plan's clock.
        d0: lower bound of the distance at `begin`, m.
        d1: lower bound of the distance at `end`, m.
        shapes: index of the pair of shapes.
    """

    begin: Array
    end: Array
    d0: Array
    d1: Array
    shapes: Indices

    def __getitem__(self, mask: Mask) -> "_Open":
        begin, end, d0, d1 = (a[mask] for a in (self.begin, self.end, self.d0, self.d1))
        return _Open(begin, end, d0, d1, self.shapes[mask])


class _TooMuchWork(Exception):
    """The work limit is exceeded at `time`, s on the plan's clock."""

    def __init__(self, time: float) -> None:
        super().__init__(time)
        self.time = time


@dataclass(frozen=True, eq=False)
class ClearanceReport:
    """Clearances of a motion; for the fields see `Verdict`."""

    clearances: tuple[PairClearance, ...]
    elsewhere: float
    queries: int


def check_clearances(
    model: CellModel,
    legs: Sequence[Leg],
    frames: Sequence[Array],
    taking_part: tuple[bool, bool],
    found: Findings,
) -> ClearanceReport:
    """Check every pair of bodies over the whole motion. Adds the checks `clearance` and
    `finger_table`.

    Args:
        model: of the cell.
        legs: the motion.
        frames: per leg the (n, 15, 4, 4) poses of the joints' child frames at its samples.
        taking_part: which arms' fingers may touch the working table in the contact windows.
        found: receives checks and violations; a motion that exceeds the work limit is refused.
    """
    search = _Search(model, taking_part)
    try:
        for leg, X_WJ in zip(legs, frames, strict=True):
            search.run(leg, X_WJ)
    except _TooMuchWork as reached:
        found.fail(
            "clearance",
            f"the distances between bodies cannot be verified within {MOST_BOUNDED} bounds and "
            f"{MOST_MEASURED} measured distances; that was used up at {reached.time:.3f} s",
            reached.time,
        )
        return ClearanceReport((), 0.0, search.queries)
    return search.report(found)


class _Search:
    def __init__(self, model: CellModel, taking_part: tuple[bool, bool]) -> None:
        self._model = model
        self._pair_of = model.pair_of
        required = np.array([pair.required for pair in model.pairs])
        touching = np.array([pair.arm >= 0 and taking_part[pair.arm] for pair in model.pairs])
        self._required = required[self._pair_of]
        self._touching = touching[self._pair_of]
        count = len(model.pairs)
        self._nearest = np.full(count, np.inf)
        self._nearest_time = np.zeros(count)
        self._margin = np.full(count, np.inf)
        self._margin_time = np.zeros(count)
        self._margin_required = required.copy()
        self._bound = np.full(count, np.inf)
        self._broken: dict[int, str] = {}
        self._unresolved: dict[int, tuple[float, float]] = {}
        # Last separating direction of each pair of shapes: a good candidate at the next time.
        self._directions = np.zeros((len(self._pair_of), 3))
        self.queries = 0
        self._bounded = self._measured = 0

    def run(self, leg: Leg, X_WJ: Array) -> None:
        """Bound all distances over one leg."""
        self._leg, self._X_WJ = leg, X_WJ
        self._speed = _pair_speeds(self._model, leg, X_WJ)
        clock = np.cumsum(self._speed * leg.step, axis=0)
        self._clock = np.vstack([np.zeros((1, clock.shape[1])), clock])
        times = self._first_times()
        shapes = np.arange(len(self._pair_of))
        count = len(shapes)
        block = max(1, BLOCK // count)
        self._spend(len(times) * count, float(times[0]))
        blocks = []
        for i in range(0, len(times), block):
            some = times[i : i + block]
            rows = np.repeat(np.arange(len(some)), count)
            blocks.append(self._distances(some, rows, np.tile(shapes, len(some))))
        distances = np.concatenate(blocks).reshape(len(times), count)
        work = _Open(
            np.repeat(times[:-1], count),
            np.repeat(times[1:], count),
            distances[:-1].ravel(),
            distances[1:].ravel(),
            np.tile(shapes, len(times) - 1),
        )
        while len(work.shapes):
            work = self._halve(work)

    def _spend(self, bounded: int, time: float, measured: int = 0) -> None:
        self._bounded += bounded
        self._measured += measured
        if self._bounded > MOST_BOUNDED or self._measured > MOST_MEASURED:
            raise _TooMuchWork(time)

    def _first_times(self) -> Array:
        """Choose samples between which no pair moves by more than FIRST_STEP, and the ends of the
        contact window.
        """
        leg = self._leg
        fastest = np.concatenate([[0.0], np.cumsum(self._speed.max(axis=1) * leg.step[:, 0])])
        count = min(int(np.ceil(fastest[-1] / FIRST_STEP)) + 1, len(leg.times))
        chosen = np.searchsorted(fastest, np.linspace(0.0, fastest[-1], count))
        chosen = np.concatenate([[0], chosen, [len(leg.times) - 1]])
        times = leg.times[np.minimum(chosen, len(leg.times) - 1)]
        ends = [] if leg.contact is None else leg.contact
        inside = [t for t in ends if leg.times[0] < t < leg.times[-1]]
        return np.unique(np.concatenate([times, inside]))

    def _in_contact(self, begin: Array, end: Array) -> Mask:
        low, high = (np.inf, -np.inf) if self._leg.contact is None else self._leg.contact
        return (low - 1e-9 <= begin) & (end <= high + 1e-9)

    def _demands(self, begin: Array, end: Array, shapes: Indices) -> tuple[Array, Array]:
        """Return the least allowed distances of shape pairs in intervals, m.

        At samples, and between samples.
        """
        required = self._required[shapes]
        touching = self._touching[shapes] & self._in_contact(begin, end)
        on_samples = required - MEASUREMENT_ERROR * (required > 0.0)
        between = np.maximum(required - SHORTFALL_BETWEEN_SAMPLES, 0.0)
        return (
            np.where(touching, -CONTACT_DEPTH, on_samples),
            np.where(touching, -CONTACT_DEPTH, between),
        )

    def _distances(self, moments: Array, rows: Indices, shapes: Indices) -> Array:
        """Return lower bounds (m,) of the distances of shape pairs at moments[rows], m.

        Measured where the bound is too low.
        """
        model = self._model
        axes, centres = model.outline_poses(self._frames_at(moments))
        first, second = model.first[shapes], model.second[shapes]
        p = centres[rows, second] - centres[rows, first]
        distances = np.sqrt(np.einsum("mi,mi->m", p, p)) - model.reach[shapes]
        near = np.flatnonzero(distances < MEASURED_BELOW)
        rows, shapes, first, second = (a[near] for a in (rows, shapes, first, second))
        p = p[near]
        R = axes[rows, first], axes[rows, second]
        bound = face_gaps(model.shapes, first, second, R, p, self._directions[shapes])
        times = moments[rows]
        on_samples, between = self._demands(times, times, shapes)
        allowed = np.where(np.isin(times, self._leg.times), on_samples, between)
        padding = np.where(allowed < 0.0, 0.0, self._required[shapes])
        pairs = self._pair_of[shapes]
        query: QueryObject | None = None
        at = -1
        # Smallest first: later pairs then often need no measurement.
        for k in np.argsort(bound)[: int(np.sum(bound < MEASURED_BELOW))]:
            i, d = int(pairs[k]), bound[k]
            worth = (
                d < self._nearest[i] - LEAST_GAIN or d - padding[k] < self._margin[i] - LEAST_GAIN
            )
            if not worth and d >= allowed[k]:
                continue
            time = float(times[k])
            if query is None or rows[k] != at:
                at = rows[k]
                query = model.set_positions(self._leg.at(time))
                self.queries += 1
            a, b = int(first[k]), int(second[k])
            self._spend(0, time, 1)
            d, n = measure(query, model.shapes, a, b, (R[0][k], R[1][k]), p[k])
            bound[k], self._directions[shapes[k]] = d, n
            self._note(i, time, d, float(allowed[k]), float(padding[k]))
        distances[near] = bound
        return distances

    def _frames_at(self, moments: Array) -> Array:
        """Return the poses (m, 15, 4, 4) of the joints' child frames at times.

        Those at samples are stored.
        """
        leg = self._leg
        index = np.minimum(np.searchsorted(leg.times, moments), len(leg.times) - 1)
        X_WJ = self._X_WJ[index]
        other = np.flatnonzero(leg.times[index] != moments)
        if len(other):
            positions = np.array([leg.at(float(time)) for time in moments[other]])
            X_WJ[other] = self._model.frames(positions)[0]
        return X_WJ

    def _note(self, i: int, time: float, d: float, allowed: float, padding: float) -> None:
        if d < self._nearest[i]:
            self._nearest[i], self._nearest_time[i] = d, time
        if d - padding < self._margin[i]:
            self._margin[i], self._margin_time[i] = d - padding, time
            self._margin_required[i] = padding
        if d < allowed and (i not in self._broken or self._margin_time[i] == time):
            self._broken[i] = _broken(self._model.pairs[i], d, padding, time)

    def _halve(self, work: _Open) -> _Open:
        """Drop intervals whose bound is high enough, and bound the distances in the middle of the
        others.
        """
        pairs = self._pair_of[work.shapes]
        clock = self._clock_at(work.end, pairs) - self._clock_at(work.begin, pairs)
        # d0 and d1 are lower bounds, so they may differ by more than the motion bound.
        bound = np.minimum(np.minimum(work.d0, work.d1), 0.5 * (work.d0 + work.d1 - clock))
        samples = self._leg.times
        first = np.searchsorted(samples, work.begin, side="right")
        last = np.searchsorted(samples, work.end)
        on_samples, between = self._demands(work.begin, work.end, work.shapes)
        nearest = self._nearest[pairs]
        near = nearest < self._required[work.shapes] + REFINED_WITHIN
        wanted = np.where(near, nearest - np.clip(REFINED_SHARE * nearest, *REFINED), -np.inf)
        open_ = bound < np.maximum(np.where(first < last, on_samples, between), wanted)
        # Pairs with a violation are not refined further.
        broken = np.zeros(len(self._nearest), dtype=bool)
        broken[list(self._broken)] = True
        short = work.end - work.begin < SHORTEST_INTERVAL
        for i in np.flatnonzero(open_ & short & (bound < between)):
            self._unresolved.setdefault(int(pairs[i]), (float(work.begin[i]), float(work.end[i])))
        open_ &= ~broken[pairs] & ~short
        np.minimum.at(self._bound, pairs[~open_], bound[~open_])
        if not np.any(open_):
            return work[open_]
        work = work[open_]
        first, last = first[open_], last[open_]
        middle = np.where(
            first < last,
            samples[np.minimum((first + last) // 2, len(samples) - 1)],
            0.5 * (work.begin + work.end),
        )
        self._spend(len(middle), float(work.begin.min()))
        moments, rows = np.unique(middle, return_inverse=True)
        d = self._distances(moments, rows, work.shapes)
        return _Open(
            np.concatenate([work.begin, middle]),
            np.concatenate([middle, work.end]),
            np.concatenate([work.d0, d]),
            np.concatenate([d, work.d1]),
            np.tile(work.shapes, 2),
        )

    def _clock_at(self, times: Array, pairs: Indices) -> Array:
        samples = self._leg.times
        i = np.clip(np.searchsorted(samples, times, side="right") - 1, 0, len(samples) - 2)
        return self._clock[i, pairs] + (times - samples[i]) * self._speed[i, pairs]

    def report(self, found: Findings) -> ClearanceReport:
        """Add violations and checks, and return the clearances, smallest margin first."""
        clearances, elsewhere = [], np.inf
        for i, pair in enumerate(self._model.pairs):
            check = "finger_table" if pair.kind == "finger-table" else "clearance"
            if i in self._broken:
                found.fail(check, self._broken[i], float(self._margin_time[i]))
            elif i in self._unresolved:
                begin, end = self._unresolved[i]
                found.fail(
                    check,
                    f"the distance of {' and '.join(pair.names)} cannot be bounded well enough "
                    f"between {begin:.4f} and {end:.4f} s",
                    begin,
                )
            if np.isfinite(self._nearest[i]):
                clearances.append(self._clearance(i, pair))
            else:
                elsewhere = min(elsewhere, float(self._bound[i]))
        elsewhere = elsewhere if np.isfinite(elsewhere) else 0.0
        clearances.sort(key=lambda pair: pair.margin)
        for name, among in (
            ("clearance", [c for c in clearances if c.kind not in NEAR_BY_DESIGN]),
            ("finger_table", [c for c in clearances if c.kind == "finger-table"]),
        ):
            if not among:
                found.check(name, where=f"nothing within {1e3 * elsewhere:.0f} mm")
                continue
            worst = among[0]
            index = next(i for i, p in enumerate(self._model.pairs) if p.names == worst.bodies)
            time, where = float(self._margin_time[index]), " - ".join(worst.bodies)
            value = worst.margin + worst.required
            found.check(name, value, worst.required, worst.margin, "m", where, time)
        return ClearanceReport(tuple(clearances), elsewhere, self.queries)

    def _clearance(self, i: int, pair: BodyPair) -> PairClearance:
        return PairClearance(
            pair.names,
            pair.kind,
            float(self._nearest[i]),
            float(self._nearest_time[i]),
            float(min(self._bound[i], self._nearest[i])),
            float(self._margin_required[i]),
            float(self._margin[i]),
        )


def _broken(pair: BodyPair, distance: float, padding: float, time: float) -> str:
    names = " and ".join(pair.names)
    if distance < 0.0:
        return (
            f"{names} collide at {time:.3f} s, {-1e3 * distance:.1f} mm deep ({pair.kind}, "
            f"{1e3 * padding:.0f} mm apart required)"
        )
    return (
        f"{names} are {1e3 * distance:.2f} mm apart at {time:.3f} s, "
        f"{1e3 * (padding - distance):.2f} mm less than the {1e3 * padding:.0f} mm required "
        f"({pair.kind})"
    )


def _pair_speeds(model: CellModel, leg: Leg, X_WJ: Array) -> Array:
    """Bound the relative speed of every pair of bodies in every interval of a leg, (n-1, pairs),
    m/s.
    """
    directions = model.axis_directions()
    step = leg.step[:, 0]
    speeds = []
    for chain, corners in zip(model.chains, model.corners, strict=True):
        columns = list(chain)
        rho = distances_to_axes(corners, X_WJ, directions, chain)
        prismatic = [model.prismatic[joint] for joint in chain]
        speeds.append(speed_bounds(rho, step, leg.greatest_velocity[:, columns], prismatic))
    result = np.zeros((len(step), len(model.pairs)))
    for i, pair in enumerate(model.pairs):
        for body in pair.bodies:
            if body >= 0:
                result[:, i] += speeds[body][:, pair.shared]
    return result
