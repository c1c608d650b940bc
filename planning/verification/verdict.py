"""Result of a verification: every check with its margin, every violation, the clearance of every
pair.
"""

from dataclasses import asdict, dataclass, replace
from typing import Any

#: Kinds of violation, each with the condition that is checked. A check has the name of its
#: violations.
CHECKS = {
    "hash": "content, robot and limits have the hashes that the plan states",
    "speed": "the plan's speed fraction is no greater than the cell's",
    "numbers": "every number of the plan is finite and plausible",
    "structure": "segments, poses and contact windows are the expected ones, on one clock",
    "choice": "the plan's choice for each arm (hand, offset, tilt, share) is possible",
    "gripper": "grippers change state at rest, at the right time, with enough dwell",
    "sent": "the controller can represent it: whole milliseconds, float32",
    "start": "the motion begins where the robot stands",
    "rest": "every segment begins and ends at rest",
    "continuity": "every segment begins where the one before ended",
    "kinematics": "robot.yaml and the model files give the same tool poses",
    "position": "axis positions",
    "velocity": "axis velocities",
    "acceleration": "axis accelerations",
    "jerk": "axis jerks",
    "acceleration_jump": "jumps of acceleration between cubic pieces",
    "turntable": "the turn-table has the plan's angle in contact, and is still where it is fixed",
    "clearance": "distances between bodies",
    "finger_table": "distance of the fingers from the working table",
    "contact": "in contact windows and at named poses the tools are at the place of work",
    "table": "grasp, pull and put-down on the working table",
    "tip_speed": "speed of the tool centre points while a gripper is closed",
    "sliding": "speed of open fingers along the table, near it",
    "sinking": "speed of open fingers towards the table, near it",
    "stretch": "distance of the grippers against the length of cloth between them",
    "slack": "backward motion of the grippers while they hold",
    "grasp": "tool centre points when the grippers close",
    "pull": "tool centre points along the pull's line, near the table, while a gripper is closed",
    "put_down": "tool centre points when the grippers open",
    "tilt": "tilt of the tools during contact and holding",
    "heading": "direction of the tools during contact and holding",
    "roll": "blades flat to the table during contact and holding",
}

#: Kinds of pairs that are near by design: fingers and table meet, adjacent links are joined.
NEAR_BY_DESIGN = ("finger-table", "self", "adjacent")


@dataclass(frozen=True)
class Check:
    """One check and its margin.

    Attributes:
        name: key of `CHECKS`.
        passed: whether it has no violation.
        value: worst value found; None for a check without a number.
        limit: of the value, upper or lower.
        margin: distance of the value from the limit; negative where the limit is broken.
        unit: of value, limit and margin ("" for ratios).
        where: axis, arm or pair of bodies.
        time: of the worst value on the plan's clock, s.
    """

    name: str
    passed: bool
    value: float | None = None
    limit: float | None = None
    margin: float | None = None
    unit: str = ""
    where: str = ""
    time: float | None = None


@dataclass(frozen=True)
class Violation:
    """A condition that the plan breaks.

    Attributes:
        kind: key of `CHECKS`.
        message: one sentence with the figures and the limit.
        time: on the plan's clock, s; None where it has no time.
    """

    kind: str
    message: str
    time: float | None = None


@dataclass(frozen=True)
class PairClearance:
    """Smallest distance of two bodies over a plan. All lengths in m.

    Attributes:
        bodies: scoped names.
        kind: of the pair: arm-arm, arm-table, palm-table, finger-table, surroundings, adjacent or
            self.
        distance: smallest geometric distance of the collision shapes found at a checked time
            (negative: depth of penetration); the padding is not subtracted.
        time: of that distance on the plan's clock, s.
        bound: lower bound of the distance at any time of the plan, at and between samples.
        required: padding demanded where the margin is smallest (fingers need none over the working
            table while they are meant to touch it).
        margin: smallest difference of a distance found and the padding required at that time.
    """

    bodies: tuple[str, str]
    kind: str
    distance: float
    time: float
    bound: float
    required: float
    margin: float


@dataclass(frozen=True)
class Verdict:
    """Result of verifying one plan.

    Attributes:
        plan_hash: content hash of the plan that was verified.
        robot_hash: of the cell it was verified in.
        limits_hash: of the limits it was verified with.
        checks: one per entry of `CHECKS` that applies.
        violations: empty for a plan that passes.
        clearances: per pair of bodies that came within the search distance, nearest to its padding
            first.
        elsewhere: lower bound of the distance of all other pairs at any time, m.
        queries: number of configurations in which distances were measured; 0 if an earlier check
            refused the plan.
    """

    plan_hash: str
    robot_hash: str
    limits_hash: str
    checks: tuple[Check, ...]
    violations: tuple[Violation, ...]
    clearances: tuple[PairClearance, ...]
    elsewhere: float
    queries: int

    @property
    def passed(self) -> bool:
        """Whether the plan has no violation."""
        return not self.violations

    @property
    def smallest(self) -> PairClearance | None:
        """The pair with the smallest distance, of all that must not touch; None if no such pair
        came near.

        Pairs that are near by design are left out: fingers and working table, links of one arm,
        adjacent links.
        """
        pairs = [pair for pair in self.clearances if pair.kind not in NEAR_BY_DESIGN]
        return min(pairs, key=lambda pair: pair.distance, default=None)

    def check(self, name: str) -> Check:
        """Return the check of a name.

        Raises:
            KeyError: the check was not made.
        """
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)

    def to_json(self) -> dict[str, Any]:
        """Convert to plain lists, numbers and strings."""
        smallest = self.smallest
        return {
            "passed": self.passed,
            "plan_hash": self.plan_hash,
            "robot_hash": self.robot_hash,
            "limits_hash": self.limits_hash,
            "violations": [asdict(violation) for violation in self.violations],
            "checks": [asdict(check) for check in self.checks],
            "smallest_clearance": None if smallest is None else asdict(smallest),
            "clearances": [asdict(pair) for pair in self.clearances],
            "elsewhere": self.elsewhere,
            "queries": self.queries,
        }

    def rows(self) -> list[tuple[str, str, str, str, str, str]]:
        """Return the checks as text: name, result, worst value, limit, margin, place and time."""
        return [
            (
                check.name.replace("_", " "),
                "pass" if check.passed else "FAIL",
                _quantity(check.value, check.unit),
                _quantity(check.limit, check.unit),
                _quantity(check.margin, check.unit),
                check.where + ("" if check.time is None else f", {check.time:.3f} s"),
            )
            for check in self.checks
        ]

    def clearance_rows(self, count: int = 12) -> list[tuple[str, str, str, str, str, str]]:
        """Return the pairs with the smallest margins as text.

        Bodies, kind, distance, bound, required, time.
        """
        return [
            (
                " - ".join(pair.bodies),
                pair.kind,
                _quantity(pair.distance, "m"),
                _quantity(pair.bound, "m"),
                _quantity(pair.required, "m"),
                f"{pair.time:.3f} s",
            )
            for pair in self.clearances[:count]
        ]

    def summary(self) -> str:
        """Return one sentence: whether the plan is verified, and the smallest clearance."""
        pair = self.smallest
        near = f"no two bodies nearer than {1e3 * self.elsewhere:.0f} mm"
        if pair is not None:
            near = (
                f"smallest clearance {1e3 * pair.distance:.1f} mm between "
                f"{' and '.join(pair.bodies)} at {pair.time:.3f} s (required "
                f"{1e3 * pair.required:.0f} mm, at any time at least {1e3 * pair.bound:.1f} mm)"
            )
        if self.queries == 0 and not self.passed:
            near = "distances were not computed, because an earlier check failed"
        count = len(self.violations)
        state = "verified against the model of the cell"
        if not self.passed:
            state = f"NOT verified: {count} violation{'s' if count > 1 else ''}"
        return f"plan {self.plan_hash[:12]} is {state}; {near}"


def _quantity(value: float | None, unit: str) -> str:
    if value is None:
        return ""
    if unit == "m":
        return f"{1e3 * value:.1f} mm"
    return f"{value:.4g} {unit}".rstrip()


class Findings:
    """Collector of checks and violations during a verification."""

    def __init__(self) -> None:
        """Start without any."""
        self.violations: list[Violation] = []
        self._checks: dict[str, Check] = {}

    def fail(self, kind: str, message: str, time: float | None = None) -> None:
        """Add a violation.

        Raises:
            KeyError: the kind is none of `CHECKS`.
        """
        if kind not in CHECKS:
            raise KeyError(kind)
        self.violations.append(Violation(kind, message, time))

    def check(
        self,
        name: str,
        value: float | None = None,
        limit: float | None = None,
        margin: float | None = None,
        unit: str = "",
        where: str = "",
        time: float | None = None,
    ) -> None:
        """Add a check and its worst value; of several of one name the one with the least margin is
        kept.

        A check passes unless there is a violation of its kind.
        """
        before = self._checks.get(name)
        if before is None or (margin or 0.0) < (before.margin or 0.0):
            self._checks[name] = Check(name, True, value, limit, margin, unit, where, time)

    def failed(self, *kinds: str) -> bool:
        """Return whether there is a violation of one of the kinds."""
        return any(violation.kind in kinds for violation in self.violations)

    def checks(self) -> tuple[Check, ...]:
        """Return the checks with their results, violations without a check included."""
        failed = {violation.kind for violation in self.violations}
        return tuple(
            replace(self._checks.get(name, Check(name, True)), passed=name not in failed)
            for name in CHECKS
            if name in self._checks or name in failed
        )
