"""Clearances between bodies, on samples and proven between them.

Every pair of bodies has a clock S(t) that runs as fast as any point of one can move against the other (see
`verification_bounds`). The distance of the pair cannot change faster than its clock. So if it is d0 at t0 and d1 at t1, it is
nowhere in between less than (d0 + d1 - (S(t1) - S(t0))) / 2. Distances are measured at a few samples first, and then wherever
that bound does not reach what is required, halving the interval, down into the cubic between two samples if need be.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.planning.verification_bounds import distances_to_axes, speed_bounds
from unwrinkle.planning.verification_model import BodyPair, CellModel
from unwrinkle.planning.verification_motion import Leg
from unwrinkle.planning.verification_verdict import Findings, PairClearance

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

#: Bodies further apart are not measured, m.
SEARCH_DISTANCE = 0.200
#: No two neighbouring first measurements are further apart than this in any pair's relative motion, m.
FIRST_STEP = 0.080
#: Below the padding by no more than this between two samples, m; never below contact.
DIP = 1e-3
#: Error of a measured distance, m.
MEASUREMENT = 1e-5
#: How deep a finger may seem to sink into the working table where it is meant to touch it, m.
CONTACT_DEPTH = 1e-4
#: A pair within NEAR of its padding is measured until the proven bound is no further below the distance found than 0.3 of it,
#: but at least and at most by these, m.
NEAR = 0.030
RESOLUTION = (1e-3, 5e-3)
#: Intervals are not halved below this, s.
SHORTEST = 2e-5


@dataclass(frozen=True, eq=False)
class _Interval:
    """Shape pairs whose distances are known at both ends of an interval of one leg."""

    times: tuple[float, float]
    shapes: Indices
    distances: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class ClearanceReport:
    """What was found; see `Verdict`."""

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
    """Check every pair of bodies over the whole motion. Adds the checks `clearance` and `finger_table`.

    Args:
        model: of the cell.
        legs: the motion.
        frames: per leg the (n, 15, 4, 4) poses of the joints' child frames at its samples.
        taking_part: which arms' fingers may touch the working table in the contact windows.
        found: takes checks and violations.
    """
    search = _Search(model, taking_part)
    for leg, X_WJ in zip(legs, frames, strict=True):
        search.run(leg, X_WJ)
    return search.report(found)


class _Search:
    def __init__(self, model: CellModel, taking_part: tuple[bool, bool]) -> None:
        self._model = model
        self._pair_of = np.array([pair for _, _, pair in model.geometries], dtype=np.intp)
        self._ids = [(a, b) for a, b, _ in model.geometries]
        self._index = {}
        for i, (a, b) in enumerate(self._ids):
            self._index[a.get_value(), b.get_value()] = i
            self._index[b.get_value(), a.get_value()] = i
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
        self._bound = np.full(count, SEARCH_DISTANCE)
        self._broken: dict[int, str] = {}
        self._unproven: dict[int, tuple[float, float]] = {}
        self.queries = 0

    def run(self, leg: Leg, X_WJ: Array) -> None:
        """Look at one leg."""
        self._leg = leg
        self._speed = _pair_speeds(self._model, leg, X_WJ)
        step = leg.step
        self._clock = np.vstack(
            [np.zeros((1, self._speed.shape[1])), np.cumsum(self._speed * step, axis=0)]
        )
        times = self._first_times()
        distances = np.array([self._measure_all(time) for time in times])
        clocks = np.array([self._clock_at(time) for time in times])[:, self._pair_of]
        work = []
        for i in range(len(times) - 1):
            between = (float(times[i]), float(times[i + 1]))
            d0, d1 = distances[i], distances[i + 1]
            bound = _bound(d0, d1, clocks[i + 1] - clocks[i])
            open_ = self._insufficient(between, np.arange(len(bound)), bound)
            self._note_bound(np.flatnonzero(~open_), bound[~open_])
            if np.any(open_):
                work.append(_Interval(between, np.flatnonzero(open_), (d0[open_], d1[open_])))
        while work:
            work += self._halve(work.pop())

    def _first_times(self) -> Array:
        """Samples between which no pair moves far, and the ends of the contact window."""
        leg = self._leg
        fastest = np.concatenate([[0.0], np.cumsum(self._speed.max(axis=1) * leg.step[:, 0])])
        count = int(np.ceil(fastest[-1] / FIRST_STEP)) + 1
        chosen = np.searchsorted(fastest, np.linspace(0.0, fastest[-1], count))
        chosen = np.unique(np.concatenate([[0], chosen, [len(leg.times) - 1]]))
        times = leg.times[np.minimum(chosen, len(leg.times) - 1)]
        if leg.contact is not None:
            inside = [t for t in leg.contact if leg.times[0] < t < leg.times[-1]]
            times = np.unique(np.concatenate([times, inside]))
        return times

    def _clock_at(self, time: float) -> Array:
        times = self._leg.times
        i = min(max(int(np.searchsorted(times, time, side="right")) - 1, 0), len(times) - 2)
        return self._clock[i] + (time - times[i]) * self._speed[i]

    def _in_contact(self, begin: float, end: float) -> bool:
        window = self._leg.contact
        return window is not None and window[0] - 1e-9 <= begin and end <= window[1] + 1e-9

    def _demands(self, times: tuple[float, float], shapes: Indices) -> tuple[Array, Array]:
        """Padding of shape pairs in an interval on samples, and what it may dip to between them."""
        required = self._required[shapes]
        floor = np.maximum(required - DIP, 0.0)
        required = required - MEASUREMENT * (required > 0.0)
        if self._in_contact(*times):
            touching = self._touching[shapes]
            required = np.where(touching, -CONTACT_DEPTH, required)
            floor = np.where(touching, -CONTACT_DEPTH, floor)
        return required, floor

    def _insufficient(self, times: tuple[float, float], shapes: Indices, bound: Array) -> Mask:
        """Which of the shape pairs need measuring within the interval."""
        required, floor = self._demands(times, shapes)
        inner = self._inner_samples(times)
        pairs = self._pair_of[shapes]
        nearest = self._nearest[pairs]
        near = nearest < self._required[shapes] + NEAR
        wanted = np.where(near, nearest - np.clip(0.3 * nearest, *RESOLUTION), -np.inf)
        return bound < np.maximum(required if len(inner) else floor, wanted)

    def _inner_samples(self, times: tuple[float, float]) -> Array:
        samples = self._leg.times
        first, last = (
            np.searchsorted(samples, times[0], "right"),
            np.searchsorted(samples, times[1]),
        )
        return samples[first:last]

    def _measure_all(self, time: float) -> Array:
        """Distances of all shape pairs, SEARCH_DISTANCE where they are further apart."""
        query = self._model.set_positions(self._leg.at(time))
        self.queries += 1
        distances = np.full(len(self._ids), SEARCH_DISTANCE)
        results = query.ComputeSignedDistancePairwiseClosestPoints(SEARCH_DISTANCE)
        near = [self._index[r.id_A.get_value(), r.id_B.get_value()] for r in results]
        distances[near] = [r.distance for r in results]
        self._note(time, np.array(near, dtype=np.intp), distances[near])
        return distances

    def _measure(self, time: float, shapes: Indices) -> Array:
        query = self._model.set_positions(self._leg.at(time))
        self.queries += 1
        measure = query.ComputeSignedDistancePairClosestPoints
        distances = np.array([measure(*self._ids[i]).distance for i in shapes])
        self._note(time, shapes, distances)
        return distances

    def _note(self, time: float, shapes: Indices, distances: Array) -> None:
        demanded, floor = self._demands((time, time), shapes)
        sample = bool(np.any(np.abs(self._leg.times - time) < 1e-12))
        allowed = demanded if sample else np.minimum(demanded, floor)
        required = self._required[shapes]
        if self._in_contact(time, time):
            required = np.where(self._touching[shapes], 0.0, required)
        for shape, d, least, padding in zip(shapes, distances, allowed, required, strict=True):
            i = int(self._pair_of[shape])
            if d < self._nearest[i]:
                self._nearest[i], self._nearest_time[i] = d, time
            if d - padding < self._margin[i]:
                self._margin[i], self._margin_time[i] = d - padding, time
                self._margin_required[i] = padding
                if d < least:
                    self._broken[i] = _broken(self._model.pairs[i], d, padding, time)

    def _note_bound(self, shapes: Indices, bound: Array) -> None:
        np.minimum.at(self._bound, self._pair_of[shapes], bound)

    def _halve(self, interval: _Interval) -> list[_Interval]:
        begin, end = interval.times
        shapes = interval.shapes
        clock = (self._clock_at(end) - self._clock_at(begin))[self._pair_of[shapes]]
        bound = _bound(*interval.distances, clock)
        # What was seen to be broken, or proven elsewhere to be far from nearest, needs no more looking.
        broken = np.array([int(self._pair_of[i]) in self._broken for i in shapes])
        open_ = self._insufficient(interval.times, shapes, bound) & ~broken
        self._note_bound(shapes[~open_], bound[~open_])
        if not np.any(open_):
            return []
        shapes = shapes[open_]
        d0, d1 = (d[open_] for d in interval.distances)
        inner = self._inner_samples(interval.times)
        middle = float(inner[len(inner) // 2]) if len(inner) else 0.5 * (begin + end)
        if end - begin < SHORTEST:
            self._note_bound(shapes, bound[open_])
            for i in self._pair_of[shapes]:
                self._unproven.setdefault(int(i), (begin, end))
            return []
        d = self._measure(middle, shapes)
        return [
            _Interval((begin, middle), shapes, (d0, d)),
            _Interval((middle, end), shapes, (d, d1)),
        ]

    def report(self, found: Findings) -> ClearanceReport:
        """Violations, checks, and the clearances, nearest to their padding first."""
        clearances, elsewhere = [], SEARCH_DISTANCE
        for i, pair in enumerate(self._model.pairs):
            check = "finger_table" if pair.kind == "finger-table" else "clearance"
            if i in self._broken:
                found.fail(check, self._broken[i], float(self._margin_time[i]))
            elif i in self._unproven:
                begin, end = self._unproven[i]
                found.fail(
                    check,
                    f"{' and '.join(pair.names)} cannot be proven to keep apart between {begin:.4f} and "
                    f"{end:.4f} s",
                    begin,
                )
            if np.isfinite(self._nearest[i]):
                clearances.append(self._clearance(i, pair))
            else:
                elsewhere = min(elsewhere, float(self._bound[i]))
        clearances.sort(key=lambda pair: pair.margin)
        meant = ("finger-table", "self", "adjacent")
        for name, among in (
            ("clearance", [c for c in clearances if c.kind not in meant]),
            ("finger_table", [c for c in clearances if c.kind == "finger-table"]),
        ):
            # Where nothing comes near there is nothing to show but that the check was made.
            if not among:
                found.check(name, where=f"nothing within {1e3 * elsewhere:.0f} mm")
                continue
            worst = among[0]
            index = next(i for i, p in enumerate(self._model.pairs) if p.names == worst.bodies)
            padding, time = float(worst.required), float(self._margin_time[index])
            where = " - ".join(worst.bodies)
            found.check(name, worst.margin + padding, padding, worst.margin, "m", where, time)
        return ClearanceReport(tuple(clearances), elsewhere, self.queries)

    def _clearance(self, i: int, pair: BodyPair) -> PairClearance:
        return PairClearance(
            pair.names,
            pair.kind,
            float(self._nearest[i]),
            float(self._nearest_time[i]),
            float(self._bound[i]),
            float(self._margin_required[i]),
            float(self._margin[i]),
        )


def _bound(d0: Array, d1: Array, clock: Array) -> Array:
    # Where a distance stands for "at least the search distance", the two ends may differ by more than the clock.
    return np.minimum(np.minimum(d0, d1), 0.5 * (d0 + d1 - clock))


def _broken(pair: BodyPair, distance: float, padding: float, time: float) -> str:
    names = " and ".join(pair.names)
    if distance < 0.0:
        return (
            f"{names} collide at {time:.3f} s, {-1e3 * distance:.1f} mm deep ({pair.kind}, "
            f"{1e3 * padding:.0f} mm apart required)"
        )
    return (
        f"{names} are {1e3 * distance:.2f} mm apart at {time:.3f} s, {1e3 * (padding - distance):.2f} mm less "
        f"than the {1e3 * padding:.0f} mm required ({pair.kind})"
    )


def _pair_speeds(model: CellModel, leg: Leg, X_WJ: Array) -> Array:
    """Bound on the relative speed of every pair of bodies in every interval of a leg, (n-1, pairs), m/s."""
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
