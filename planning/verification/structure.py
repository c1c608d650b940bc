"""Checks of a plan's structure.

Hashes, numbers, segments, gripper events, start, rest and continuity.
"""

import dataclasses as dc

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.sent_samples import as_sent
from unwrinkle.planning.verification.verdict import Findings

SEGMENTS = ("approach", "pull", "release")
#: The named poses in the segments that pass them (Sun et al. 2015, Fig. 5).
POSES = (
    ("plan", "touch-table", "grasp"),
    ("pull", "put-on-table"),
    ("free-garment", "leave-table"),
)
#: Limit of segments, poses of a segment, and gripper events; a valid plan has at most three of
#: each.
MOST_PARTS = 12
#: Limit of any number outside the samples (s, rad, shares): above it the clock's rounding error
#: would reach microseconds.
GREATEST = 1e6
#: Limit of the samples of a plan; more take too long to verify.
MOST_SAMPLES = 20_000
#: Greatest difference of the grasp direction from the target's, rad: beyond it the blades would
#: enter from the side or from inside.
GREATEST_OFFSET = np.radians(75.0)
#: Greatest pull of one hand over the target's pull distance; the shares of all hands add up to at
#: most their number.
GREATEST_SHARE = 2.0
#: Tolerance of the sum of shares.
SHARE_TOLERANCE = 1e-9
#: Tolerance of times on the plan's clock, s.
TIME_TOLERANCE = 1e-6
#: Greatest distance of the first point from the robot's configuration, rad; the tolerance of
#: MotoROS clients.
START_TOLERANCE = 1e-4
#: Greatest distance between the end of a segment and the start of the next, rad.
CONTINUITY_TOLERANCE = 1e-9
#: Greatest speed of an axis at either end of a segment, rad/s.
REST_TOLERANCE = 1e-9


def check_identity(plan: FlatteningPlan, cell: Cell, limits_hash: str, found: Findings) -> None:
    """Check the hashes of content, robot and limits that the plan states. Adds the check `hash`."""
    # `content_hash` is cached; a copy computes it again.
    if dc.replace(plan).content_hash != plan.content_hash:
        found.fail("hash", "the plan's content has changed since its hash was computed; plan again")
    if plan.robot != cell.robot.name:
        found.fail("hash", f"the plan is for robot '{plan.robot}', this is '{cell.robot.name}'")
    for what, made, here in (
        ("model of the cell", plan.robot_hash, cell.robot_hash),
        ("limits", plan.limits_hash, limits_hash),
    ):
        if made != here:
            found.fail(
                "hash",
                f"the plan was made with another {what} ({made[:12]}, here {here[:12]}); plan "
                "again",
            )
    found.check("hash", where=plan.content_hash[:12])


def check_speed(plan: FlatteningPlan, cell: Cell, found: Findings) -> None:
    """Check the plan's fraction of the catalogue speed. Adds the check `speed`."""
    allowed = cell.scenario.speed
    if not 0.0 < plan.speed <= allowed:
        found.fail(
            "speed",
            f"the plan uses {plan.speed:g} of the catalogue speed, the cell allows {allowed:g}",
        )
    found.check("speed", plan.speed, allowed, allowed - plan.speed)


def check_numbers(plan: FlatteningPlan, found: Findings) -> None:
    """Check that numbers outside the samples are finite and the counts are within limits.

    Adds the check `numbers`.
    """
    counts = [len(plan.segments), len(plan.events), *(len(s.poses) for s in plan.segments)]
    if max(counts) > MOST_PARTS:
        found.fail(
            "numbers",
            f"the plan has {counts[0]} segments with up to {max(counts[2:], default=0)} poses, and "
            f"{counts[1]} events; at most {MOST_PARTS} of each are read",
        )
        return
    numbers: list[tuple[str, float]] = [("speed", plan.speed), ("turntable", plan.turntable)]
    for name, arm in zip(("right", "left"), plan.arms, strict=True):
        if arm is not None:
            numbers += [
                (f"{name} arm's {key}", getattr(arm, key)) for key in ("offset", "tilt", "share")
            ]
            if isinstance(arm.side, bool) or not isinstance(arm.side, int | np.integer):
                found.fail("numbers", f"the {name} arm's side is {arm.side!r}, expected 0 or 1")
    for event in plan.events:
        numbers += [(f"gripper event's {key}", getattr(event, key)) for key in ("time", "dwell")]
    for segment in plan.segments:
        numbers.append((f"start of {segment.name}", segment.start))
        numbers += [(f"contact of {segment.name}", value) for value in segment.contact]
        numbers += [(f"{mark.name} of {segment.name}", mark.time) for mark in segment.poses]
    for what, value in numbers:
        if not (isinstance(value, int | float | np.number) and np.isfinite(value)):
            found.fail("numbers", f"the {what} is {value!r}, which is not a finite number")
        elif not abs(value) <= GREATEST:
            found.fail(
                "numbers", f"the {what} is {value:.3g}, at most {GREATEST:g} is possible in a plan"
            )
    count = sum(len(segment.trajectory.times) for segment in plan.segments)
    if not count <= MOST_SAMPLES:
        found.fail(
            "numbers",
            f"the plan has {count} samples and cannot be verified within {MOST_SAMPLES}; plan with "
            "a longer sample time",
        )
    found.check(
        "numbers", float(count), float(MOST_SAMPLES), float(MOST_SAMPLES - count), "", "samples"
    )


def check_choice(plan: FlatteningPlan, found: Findings) -> None:
    """Check the plan's choice of hand, offset and share for each arm. Adds the check `choice`."""
    shares = {}
    for name, arm in zip(("right", "left"), plan.arms, strict=True):
        if arm is None:
            continue
        shares[name] = arm.share
        if not abs(arm.offset) <= GREATEST_OFFSET:
            found.fail(
                "choice",
                f"the {name} arm's offset is {np.degrees(arm.offset):.0f} degrees, at most "
                f"{np.degrees(GREATEST_OFFSET):.0f} are allowed: the blades would not enter the "
                "cloth from outside",
            )
        if not 0.0 <= arm.share <= GREATEST_SHARE:
            found.fail(
                "choice",
                f"the {name} arm pulls {arm.share:g} times the target's distance, 0 to "
                f"{GREATEST_SHARE:g} are allowed",
            )
    together, allowed = sum(shares.values()), float(len(shares))
    if not together <= allowed + SHARE_TOLERANCE:
        found.fail(
            "choice",
            f"the arms pull {together:g} times a hand's distance together, at most {allowed:g} is "
            f"allowed for {len(shares)} arm{'s' if len(shares) != 1 else ''}",
        )
    found.check(
        "choice", together, allowed, allowed - together, "", "pull of all arms, of a hand's"
    )


def check_sent(plan: FlatteningPlan, found: Findings) -> FlatteningPlan | None:
    """Round the plan's segments as the controller does; None if it cannot represent them. Adds the
    check `sent`.

    Every profile of the controller carries float32 and whole milliseconds.
    """
    segments, shift, where, when = [], 0.0, "", 0.0
    for segment in plan.segments:
        try:
            sent = as_sent(segment.trajectory)
        except InputError as error:
            found.fail("sent", f"{segment.name}: {error}", segment.start)
            continue
        begin, end = segment.contact
        if end >= segment.trajectory.duration - TIME_TOLERANCE:
            end = sent.duration  # contact lasts to the end, which may be up to a millisecond later
        segments.append(dc.replace(segment, trajectory=sent, contact=(begin, end)))
        times = segment.trajectory.times
        off = np.abs(times - np.rint(1e3 * times) / 1e3)
        i = int(np.argmax(off))
        if off[i] >= shift:
            shift, where, when = float(off[i]), segment.name, segment.start + float(times[i])
    if found.failed("sent"):
        return None
    found.check("sent", shift, 1e-3, 1e-3 - shift, "s", where, when)
    return dc.replace(plan, segments=tuple(segments))


def check_structure(plan: FlatteningPlan, found: Findings) -> None:
    """Check segments, clock, poses and contact windows. Adds the check `structure`."""
    names = tuple(segment.name for segment in plan.segments)
    if names != SEGMENTS:
        found.fail("structure", f"the segments are {list(names)}, expected {list(SEGMENTS)}")
    if not any(plan.arms):
        found.fail("structure", "no arm takes part")
    sides = [arm.side for arm in plan.arms if arm is not None]
    if any(side not in (0, 1) for side in sides) or len(set(sides)) != len(sides):
        found.fail(
            "structure", f"the arms serve the hands {sides}, expected different ones of 0, 1"
        )
    end = 0.0
    for segment in plan.segments:
        if not segment.start >= end - TIME_TOLERANCE:
            found.fail(
                "structure",
                f"{segment.name} starts at {segment.start:.4f} s, before the segment before it "
                f"ends ({end:.4f} s)",
                segment.start,
            )
        end = segment.end
    for segment, expected in zip(plan.segments, POSES, strict=False):
        if segment.name not in SEGMENTS:
            continue
        duration = segment.trajectory.duration
        marks = tuple(mark.name for mark in segment.poses)
        times = np.array([0.0, *(mark.time for mark in segment.poses), duration])
        if marks != expected:
            found.fail(
                "structure", f"{segment.name} passes the poses {list(marks)}, not {list(expected)}"
            )
        if not np.all(np.diff(times) >= -TIME_TOLERANCE):
            found.fail("structure", f"the poses of {segment.name} are not in order of time")
        _check_contact(plan, segment.name, found)
    found.check("structure", where=f"{len(plan.segments)} segments, {end:.3f} s")


def _check_contact(plan: FlatteningPlan, name: str, found: Findings) -> None:
    """Check that the contact window lies between the plan pose and the leave pose."""
    segment = next(segment for segment in plan.segments if segment.name == name)
    poses = {mark.name: mark.time for mark in segment.poses}
    begin, end = segment.contact
    earliest, latest = poses.get("plan", 0.0), poses.get("leave-table", segment.trajectory.duration)
    if not earliest - TIME_TOLERANCE <= begin <= end <= latest + TIME_TOLERANCE:
        found.fail(
            "structure",
            f"the contact window of {name} is {begin:.3f} to {end:.3f} s, not within "
            f"{earliest:.3f} to {latest:.3f} s (plan pose to leave pose)",
            segment.start + begin,
        )


def check_rest(plan: FlatteningPlan, start: Array, found: Findings) -> None:
    """Check the start, rest at both ends of every segment, and continuity.

    Adds the checks `start`, `rest`, `continuity`.
    """
    first = plan.segments[0].trajectory.positions[0]
    _check_equal("start", first, start, START_TOLERANCE, "the robot stands", 0.0, plan, found)
    speed, where, when = 0.0, "", 0.0
    for segment in plan.segments:
        for time, v in (
            (segment.start, segment.trajectory.velocities[0]),
            (segment.end, segment.trajectory.velocities[-1]),
        ):
            worst = float(np.max(np.abs(v)))
            if not worst <= REST_TOLERANCE:
                found.fail(
                    "rest",
                    f"{segment.name} is not at rest at {time:.3f} s: {worst:.3g} rad/s",
                    time,
                )
            if worst >= speed:
                speed, where, when = worst, segment.name, time
    margin = REST_TOLERANCE - speed
    found.check("rest", speed, REST_TOLERANCE, margin, "rad/s", where, when)
    for before, after in zip(plan.segments, plan.segments[1:], strict=False):
        _check_equal(
            "continuity",
            after.trajectory.positions[0],
            before.trajectory.positions[-1],
            CONTINUITY_TOLERANCE,
            f"{before.name} ended",
            after.start,
            plan,
            found,
        )


def _check_equal(
    kind: str,
    value: Array,
    expected: Array,
    tolerance: float,
    what: str,
    time: float,
    plan: FlatteningPlan,
    found: Findings,
) -> None:
    difference = np.abs(value - expected)
    axis = int(np.argmax(difference))
    worst = float(difference[axis])
    if not worst <= tolerance:
        found.fail(
            kind,
            f"axis {axis} is at {value[axis]:.6f} rad at {time:.3f} s, where {what} at "
            f"{expected[axis]:.6f} rad: {worst:.3g} rad apart, at most {tolerance:g} are allowed",
            time,
        )
    found.check(kind, worst, tolerance, tolerance - worst, "rad", f"axis {axis}", time)


def check_grippers(plan: FlatteningPlan, cell: Cell, found: Findings) -> None:
    """Check states, times and dwell of the gripper events. Adds the check `gripper`."""
    taking_part = (plan.arms[0] is not None, plan.arms[1] is not None)
    opened = (False, False)
    for segment, states in zip(plan.segments, (opened, taking_part, opened), strict=False):
        if segment.closed != states:
            found.fail(
                "gripper",
                f"during {segment.name} the grippers are {_words(segment.closed)}, expected "
                f"{_words(states)}",
                segment.start,
            )
    if len(plan.events) != 2:
        found.fail("gripper", f"there are {len(plan.events)} gripper events, expected 2")
    needed = cell.scenario.gripper.opening / cell.limits.gripper.velocity
    shortest, when = np.inf, 0.0
    gaps = zip(plan.segments, plan.segments[1:], strict=False)
    for event, states, (before, after) in zip(
        plan.events, (taking_part, opened), gaps, strict=False
    ):
        if event.closed != states:
            found.fail(
                "gripper",
                f"the event at {event.time:.3f} s makes the grippers {_words(event.closed)}, "
                f"expected {_words(states)}",
                event.time,
            )
        done = event.time + event.dwell
        if not (event.time >= before.end - TIME_TOLERANCE and done <= after.start + TIME_TOLERANCE):
            found.fail(
                "gripper",
                f"the grippers change from {event.time:.3f} to {done:.3f} s, while the arms rest "
                f"only from {before.end:.3f} to {after.start:.3f} s",
                event.time,
            )
        if not event.dwell >= needed - TIME_TOLERANCE:
            found.fail(
                "gripper",
                f"the grippers get {event.dwell:.3f} s at {event.time:.3f} s, their stroke takes "
                f"{needed:.3f} s",
                event.time,
            )
        if event.dwell < shortest:
            shortest, when = event.dwell, event.time
    if np.isfinite(shortest):
        found.check("gripper", shortest, needed, shortest - needed, "s", "shortest dwell", when)


def _words(closed: tuple[bool, bool]) -> str:
    return " and ".join({True: "closed", False: "open"}.get(state, "neither") for state in closed)
