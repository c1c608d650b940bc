"""Good plans whose tools do something else than the plan claims, or than a gripper may.

Every one is refused for that.
"""

import dataclasses as dc
import json
import resource
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.perception.target import FlatteningTarget, HandTarget
from unwrinkle.planning.plan import ArmChoice, FlatteningPlan
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.sent_samples import as_sent
from unwrinkle.planning.timing.sampling import sent_ratios
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.planning.verification.postures import tool_angles
from unwrinkle.planning.verification.structure import MOST_SAMPLES
from unwrinkle.planning.verification.verifier import verify

from .remade import Change, bump, remade, shifted, turned

Maker = Callable[..., FlatteningTarget]

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(autouse=True)
def within_time_and_memory() -> Iterator[None]:
    """No mutation takes 10 s or a gigabyte."""
    clock, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert time.process_time() - clock < 10.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1_000_000  # kB


@pytest.fixture(scope="module")
def plan(planner: FlatteningPlanner, make_target: Maker) -> FlatteningPlan:
    """A good dual-arm plan; its tools are tilted by 60 degrees."""
    result = planner.plan(make_target(phi=0.4, half=0.22, pull=0.02))
    assert result.plan is not None and result.plan.dual
    return result.plan


@pytest.fixture(scope="module")
def single(planner: FlatteningPlanner, make_target: Maker) -> FlatteningPlan:
    """A good single-arm plan, of the right arm."""
    result = planner.plan(make_target(phi=0.4, half=0.22, pull=0.02), arms="single")
    assert result.plan is not None and result.plan.arms[1] is None
    return result.plan


def kinds(plan: FlatteningPlan, cell: Cell) -> set[str]:
    """The kinds of violation, each with a sentence."""
    verdict = verify(plan, cell)
    assert not verdict.passed
    assert all(len(violation.message) > 20 for violation in verdict.violations)
    assert json.dumps(verdict.to_json(), allow_nan=False)  # it can be written, whatever was found
    return {violation.kind for violation in verdict.violations}


def smoothly(share: Array, begin: float, end: float) -> Array:
    """0 before a share of the time, 1 after another one."""
    x = np.clip((share - begin) / (end - begin), 0.0, 1.0)
    return np.asarray(10 * x**3 - 15 * x**4 + 6 * x**5)


def only(arm: int, change: Change) -> Change:
    """The change for one arm."""
    return lambda a, X, share: change(a, X, share) if a == arm else X


def tilted(angle: float) -> Change:
    return lambda a, X, s: turned(X, X[:, :3, 0], np.radians(angle) * bump(s))


def rolled(angle: float) -> Change:
    return lambda a, X, s: turned(X, X[:, :3, 2], np.radians(angle) * bump(s))


def yawed(angle: float) -> Change:
    return lambda a, X, s: turned(X, np.tile(UP, (len(X), 1)), np.radians(angle) * bump(s))


def test_the_same_motion_made_anew_passes(
    plan: FlatteningPlan, single: FlatteningPlan, cell: Cell, kinematics: Kinematics
) -> None:
    """What follows is refused for what was changed, not for having been made anew."""
    for good in (plan, single):
        assert verify(remade(good, kinematics, {}, 6.0), cell).violations == ()
        nothing: Change = only(0, lambda a, X, s: shifted(X, 1e-6 * bump(s)[:, None] * UP))
        assert verify(remade(good, kinematics, {1: nothing}, 6.0), cell).violations == ()


# What the tools do between the gripper events.


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        pytest.param(tilted(10.0), "tilt", id="tilt 10 deg more"),
        pytest.param(tilted(-20.0), "tilt", id="tilt 20 deg less"),
        pytest.param(tilted(25.0), "tilt", id="tilt 85 deg"),
        pytest.param(tilted(40.0), "tilt", id="past the vertical"),
        pytest.param(rolled(5.0), "roll", id="roll 5 deg"),
        pytest.param(rolled(-45.0), "roll", id="roll 45 deg"),
        pytest.param(yawed(10.0), "heading", id="yaw 10 deg"),
        pytest.param(yawed(-60.0), "heading", id="yaw 60 deg"),
    ],
)
def test_a_tool_turned_during_the_pull(
    plan: FlatteningPlan, cell: Cell, kinematics: Kinematics, change: Change, reason: str
) -> None:
    spoilt = remade(plan, kinematics, {1: only(1 if reason == "heading" else 0, change)}, 10.0)
    assert kinds(spoilt, cell) == {reason}


@pytest.mark.parametrize("angle", [10.0, 20.0])
def test_a_blade_rolled_at_the_grasp(
    plan: FlatteningPlan, cell: Cell, kinematics: Kinematics, angle: float
) -> None:
    def during(profile: Callable[[Array], Array]) -> Change:
        return only(0, lambda a, X, s: turned(X, X[:, :3, 2], np.radians(angle) * profile(s)))

    changes = {
        0: during(lambda s: smoothly(s, 0.6, 0.95)),
        1: during(np.ones_like),
        2: during(lambda s: 1.0 - smoothly(s, 0.1, 0.4)),
    }
    assert kinds(remade(plan, kinematics, changes, 6.0), cell) == {"roll"}


def test_both_hands_sideways_and_back(
    plan: FlatteningPlan, cell: Cell, kinematics: Kinematics
) -> None:
    along = np.append(plan.target.wrinkle_direction, 0.0)
    sideways: Change = lambda a, X, s: shifted(X, 0.1 * bump(s)[:, None] * along)
    assert kinds(remade(plan, kinematics, {1: sideways}, 8.0), cell) == {"pull"}


@pytest.mark.parametrize("height", [0.02, 0.06])
def test_one_hand_up(
    plan: FlatteningPlan, cell: Cell, kinematics: Kinematics, height: float
) -> None:
    up = only(0, lambda a, X, s: shifted(X, height * bump(s)[:, None] * UP))
    spoilt = remade(plan, kinematics, {1: up}, 8.0)
    assert kinds(spoilt, cell) == {"pull"}
    assert "holds cloth up to" in verify(spoilt, cell).violations[0].message


def pulled(
    plan: FlatteningPlan, kinematics: Kinematics, length: float, share: float
) -> FlatteningPlan:
    """The single-arm plan, its hand pulled further by a length, m, with another share claimed."""
    arm = next(i for i, choice in enumerate(plan.arms) if choice is not None)
    choice = plan.arms[arm]
    assert choice is not None
    way = np.append(plan.target.hands[choice.side].pull_direction, 0.0) * length
    further = only(arm, lambda a, X, s: shifted(X, smoothly(s, 0.0, 1.0)[:, None] * way))
    back = only(arm, lambda a, X, s: shifted(X, (1.0 - smoothly(s, 0.0, 0.5))[:, None] * way))
    arms: list[ArmChoice | None] = [None, None]
    arms[arm] = dc.replace(choice, share=share)
    made = remade(plan, kinematics, {1: further, 2: back}, 8.0)
    return dc.replace(made, arms=(arms[0], arms[1]))


def test_one_arm_pulls_further_than_it_claims(
    single: FlatteningPlan, cell: Cell, kinematics: Kinematics
) -> None:
    assert kinds(pulled(single, kinematics, 0.06, 1.0), cell) == {"pull", "put_down"}


@pytest.mark.parametrize(
    ("length", "share", "expected"),
    [(0.02, 2.0, {"choice"}), (0.06, 4.0, {"choice"}), (0.14, 8.0, {"choice", "stretch"})],
)
def test_one_arm_pulls_further_than_the_target_says(
    single: FlatteningPlan,
    cell: Cell,
    kinematics: Kinematics,
    length: float,
    share: float,
    expected: set[str],
) -> None:
    assert kinds(pulled(single, kinematics, length, share), cell) == expected


def test_one_arm_goes_back(single: FlatteningPlan, cell: Cell, kinematics: Kinematics) -> None:
    way = np.append(single.target.hands[0].pull_direction, 0.0)
    back = only(0, lambda a, X, s: shifted(X, -0.03 * bump(s)[:, None] * way))
    assert "slack" in kinds(remade(single, kinematics, {1: back}, 8.0), cell)


def test_samples_too_far_apart_do_not_hide_a_tool(
    plan: FlatteningPlan, cell: Cell, kinematics: Kinematics
) -> None:
    """The pull rolled by 10 degrees, told by its slow middle and its ends alone.

    The cubic in between counts.
    """
    rolling = remade(plan, kinematics, {1: only(0, rolled(10.0))}, 20.0)
    t = rolling.segments[1].trajectory
    few = np.unique(np.append(np.arange(0, len(t.times), 60), len(t.times) - 1))
    segments = list(rolling.segments)
    coarse = Trajectory(t.times[few], t.positions[few], t.velocities[few])
    segments[1] = dc.replace(segments[1], trajectory=coarse)
    found = kinds(dc.replace(rolling, segments=tuple(segments)), cell)
    assert "roll" in found and "jerk" not in found


# What the plan claims.


def with_hand(plan: FlatteningPlan, change: Callable[[HandTarget], HandTarget]) -> FlatteningPlan:
    """The plan with another target for the first hand."""
    hands = (change(plan.target.hands[0]), plan.target.hands[1])
    return dc.replace(plan, target=dc.replace(plan.target, hands=hands))


@pytest.mark.parametrize("angle", [3.0, 30.0, 60.0, 90.0, 180.0])
def test_fingers_off_the_grasp_direction(plan: FlatteningPlan, cell: Cell, angle: float) -> None:
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))

    def turn(hand: HandTarget) -> HandTarget:
        x, y = hand.grasp_direction
        return dc.replace(hand, grasp_direction=[c * x - s * y, s * x + c * y])

    assert kinds(with_hand(plan, turn), cell) == {"heading"}


@pytest.mark.parametrize(
    ("claim", "reason"),
    [
        ({"offset": np.radians(15.0)}, "heading"),
        ({"offset": np.radians(90.0)}, "choice"),
        ({"tilt": np.radians(6.0)}, "tilt"),
        ({"tilt": np.radians(45.0)}, "tilt"),
        ({"share": 1.3}, "choice"),
        ({"share": 0.5}, "put_down"),
        ({"share": -1.0}, "choice"),
    ],
)
def test_claims_of_an_arm(
    plan: FlatteningPlan, cell: Cell, claim: dict[str, float], reason: str
) -> None:
    assert plan.arms[0] is not None
    arms = (dc.replace(plan.arms[0], **claim), plan.arms[1])
    assert reason in kinds(dc.replace(plan, arms=arms), cell)


@pytest.mark.parametrize("angle", [0.01, 1.0])
def test_claimed_turntable(plan: FlatteningPlan, cell: Cell, angle: float) -> None:
    claimed = dc.replace(plan, turntable=plan.turntable + angle)
    assert kinds(claimed, cell) == {"turntable"}


def test_turntable_turned_where_it_is_fixed(
    planner: FlatteningPlanner, cell: Cell, make_target: Maker
) -> None:
    turning = planner.plan(make_target((0.0, -1.15), np.pi / 2)).plan
    assert turning is not None and turning.turntable != 0.0
    options = dc.replace(cell.scenario.planner, turntable="fixed")
    fixed = load_cell(dc.replace(cell.scenario, planner=options))
    assert verify(turning, cell).passed
    assert kinds(turning, fixed) == {"turntable"}


# Contact windows and named poses.


def marked(
    whole: FlatteningPlan,
    index: int,
    contact: tuple[float, float] | None = None,
    **times: float,
) -> FlatteningPlan:
    """The plan with named poses of a segment moved, and its contact window."""
    segments = list(whole.segments)
    old = segments[index]
    poses = tuple(
        dc.replace(m, time=times.get(m.name.replace("-", "_"), m.time)) for m in old.poses
    )
    segments[index] = dc.replace(old, poses=poses, contact=contact or old.contact)
    return dc.replace(whole, segments=tuple(segments))


def test_poses_elsewhere(plan: FlatteningPlan, cell: Cell) -> None:
    approach, pull, release = plan.segments
    times = {mark.name: mark.time for segment in plan.segments for mark in segment.poses}
    end = release.trajectory.duration
    for spoilt in (
        marked(plan, 0, touch_table=times["plan"]),
        marked(plan, 0, plan=times["plan"] - 0.3, touch_table=times["plan"] - 0.3),
        marked(plan, 0, plan=times["touch-table"]),
        marked(plan, 0, grasp=times["grasp"] - 0.2),
        marked(plan, 0, touch_table=times["grasp"] - 1.0, plan=0.0, grasp=times["grasp"] - 1.0),
        marked(plan, 1, put_on_table=pull.trajectory.duration - 0.3),
        marked(plan, 2, free_garment=times["leave-table"]),
        marked(plan, 2, leave_table=end),
    ):
        assert "contact" in kinds(spoilt, cell)
    assert approach.contact[0] == times["plan"]


def test_a_rest_before_the_grippers_change_passes(plan: FlatteningPlan, cell: Cell) -> None:
    """The grasp pose is where the tools then rest, whenever that begins."""
    t = plan.segments[0].trajectory
    longer = Trajectory(
        np.append(t.times, t.duration + 0.2),
        np.vstack([t.positions, t.positions[-1:]]),
        np.vstack([t.velocities, np.zeros((1, 13))]),
    )
    first, *others = plan.segments
    contact = (first.contact[0], longer.duration)
    later = [dc.replace(segment, start=segment.start + 0.2) for segment in others]
    segments = (dc.replace(first, trajectory=longer, contact=contact), *later)
    events = tuple(dc.replace(event, time=event.time + 0.2) for event in plan.events)
    assert verify(dc.replace(plan, segments=segments, events=events), cell).violations == ()


def test_a_contact_window_over_the_whole_way(plan: FlatteningPlan, cell: Cell) -> None:
    """With the marks moved too, so that they bound the window as they have to."""
    approach, _, release = plan.segments
    for spoilt in (
        marked(plan, 0, (0.0, approach.contact[1]), plan=0.0),
        marked(
            plan,
            0,
            (approach.contact[0] - 0.2, approach.contact[1]),
            plan=approach.contact[0] - 0.2,
        ),
        marked(
            plan, 2, (0.0, release.trajectory.duration), leave_table=release.trajectory.duration
        ),
    ):
        found = kinds(spoilt, cell)
        assert "contact" in found and "structure" not in found


# The table, and speeds near it.


@pytest.mark.parametrize(
    ("y", "pull"), [(-0.78, 0.01), (-0.82, 0.03)], ids=["grasp beyond", "put down beyond"]
)
def test_work_beyond_the_edge_of_the_table(
    cell: Cell, make_target: Maker, y: float, pull: float
) -> None:
    """Planned for a larger table; as if made for this one."""
    table = dc.replace(cell.scenario.table, size=[0.8, 0.9])
    larger = load_cell(dc.replace(cell.scenario, table=table))
    target = make_target((0.0, y - 0.20), np.pi / 2, half=0.20, pull=pull)
    plan = FlatteningPlanner(larger).plan(target).plan
    assert plan is not None and verify(plan, larger).passed
    found = kinds(dc.replace(plan, robot_hash=cell.robot_hash), cell)
    assert found == {"table"}


@pytest.mark.parametrize(
    ("setting", "kind"),
    [("sliding_speed", "sliding"), ("sinking_speed", "sinking"), ("holding_height", "pull")],
)
def test_settings_of_the_tools_are_kept(
    plan: FlatteningPlan, cell: Cell, setting: str, kind: str
) -> None:
    """The greatest value that the plan uses is allowed, a little less is not."""
    value = verify(plan, cell).check(kind).value if kind != "pull" else 0.0185
    assert value is not None
    for factor, passes in ((1.001, True), (0.95, False)):
        tools = dc.replace(cell.scenario.tools, **{setting: factor * value})
        other = load_cell(dc.replace(cell.scenario, tools=tools))
        verdict = verify(plan, other)
        assert verdict.passed == passes
        assert {violation.kind for violation in verdict.violations} == (set() if passes else {kind})


# What is sent.


def resampled(plan: FlatteningPlan, period: float) -> FlatteningPlan:
    """The same motion with samples at another period, exactly on its cubics."""
    segments = []
    for segment in plan.segments:
        path = segment.trajectory.interpolant()
        t = np.append(
            np.arange(0.0, segment.trajectory.duration - 1e-6, period), segment.trajectory.duration
        )
        trajectory = Trajectory(t, path(t), path.derivative()(t))
        segments.append(dc.replace(segment, trajectory=trajectory))
    return dc.replace(plan, segments=tuple(segments))


def test_limits_that_only_rounding_breaks(plan: FlatteningPlan, cell: Cell) -> None:
    """At 2 ms the rounding of positions to float32 is worth several times the jerk limit."""
    fine = resampled(plan, 0.002)
    t = fine.segments[0].trajectory
    assert sent_ratios(t.times, t.positions, t.velocities, cell.limits)[2] <= 1.0 + 1e-6
    found = kinds(fine, cell)
    assert "jerk" in found and not found & {"velocity", "position", "clearance"}


def test_a_slower_motion_off_the_milliseconds_passes(plan: FlatteningPlan, cell: Cell) -> None:
    """1.3 times slower: points at 10.4 ms, which the controller gets at whole ones, with the
    positions of those.
    """
    segments, events, clock = [], [], 0.0
    for i, old in enumerate(plan.segments):
        t = old.trajectory
        trajectory = Trajectory(1.3 * t.times, t.positions, t.velocities / 1.3)
        poses = tuple(dc.replace(mark, time=1.3 * mark.time) for mark in old.poses)
        contact = (1.3 * old.contact[0], 1.3 * old.contact[1])
        segments.append(
            dc.replace(old, start=clock, trajectory=trajectory, poses=poses, contact=contact)
        )
        clock = segments[-1].end
        if i < 2:
            events.append(dc.replace(plan.events[i], time=clock))
            clock += plan.events[i].dwell
    slow = dc.replace(plan, segments=tuple(segments), events=tuple(events))
    verdict = verify(slow, cell)
    assert verdict.violations == ()
    assert verdict.check("sent").value == pytest.approx(4e-4, abs=2e-4)
    sent = as_sent(slow.segments[0].trajectory)
    worst = sent_ratios(sent.times, sent.positions, sent.velocities, cell.limits)
    assert verdict.check("jerk").value >= worst[2] * (1.0 - 1e-9)


def test_what_float32_cannot_carry(plan: FlatteningPlan, cell: Cell) -> None:
    t = plan.segments[1].trajectory
    velocities = t.velocities.copy()
    velocities[5, 5] = 1e308
    segments = list(plan.segments)
    segments[1] = dc.replace(segments[1], trajectory=Trajectory(t.times, t.positions, velocities))
    assert kinds(dc.replace(plan, segments=tuple(segments)), cell) == {"sent"}


# Numbers that are none, and work without end.


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, "0.5", None])
@pytest.mark.parametrize(
    "place",
    [
        "speed",
        "turntable",
        "side",
        "offset",
        "tilt",
        "share",
        "time",
        "dwell",
        "start",
        "contact",
        "mark",
    ],
)
def test_no_number(plan: FlatteningPlan, cell: Cell, place: str, value: object) -> None:
    first, *others = plan.segments
    event, last = plan.events
    spoilt = {
        "speed": lambda: dc.replace(plan, speed=value),
        "turntable": lambda: dc.replace(plan, turntable=value),
        "start": lambda: dc.replace(plan, segments=(dc.replace(first, start=value), *others)),
        "contact": lambda: dc.replace(
            plan, segments=(dc.replace(first, contact=(0.5, value)), *others)
        ),
        "mark": lambda: dc.replace(
            plan,
            segments=(
                dc.replace(first, poses=(dc.replace(first.poses[0], time=value), *first.poses[1:])),
                *others,
            ),
        ),
        "time": lambda: dc.replace(plan, events=(dc.replace(event, time=value), last)),
        "dwell": lambda: dc.replace(plan, events=(dc.replace(event, dwell=value), last)),
    }.get(
        place,
        lambda: dc.replace(plan, arms=(dc.replace(plan.arms[0], **{place: value}), plan.arms[1])),
    )()
    assert "numbers" in kinds(spoilt, cell)


@pytest.mark.parametrize("side", [0.0, True, 2, -1])
def test_no_hand(plan: FlatteningPlan, cell: Cell, side: object) -> None:
    arms = (dc.replace(plan.arms[0], side=side), plan.arms[1])
    assert kinds(dc.replace(plan, arms=arms), cell) & {"numbers", "structure"}


def test_parts_without_end(plan: FlatteningPlan, cell: Cell) -> None:
    first, *others = plan.segments
    crowded = dc.replace(first, poses=100_000 * first.poses)
    for spoilt in (
        dc.replace(plan, segments=(crowded, *others)),
        dc.replace(plan, segments=100 * plan.segments),
        dc.replace(plan, events=10_000 * plan.events),
    ):
        verdict = verify(spoilt, cell)
        assert [violation.kind for violation in verdict.violations] == ["numbers"]
        assert len(verdict.violations[0].message) < 200


@pytest.mark.parametrize("start", [1e7, 1e300, -1e300])
def test_a_segment_at_the_end_of_time(plan: FlatteningPlan, cell: Cell, start: float) -> None:
    segments = (*plan.segments[:2], dc.replace(plan.segments[2], start=start))
    assert "numbers" in kinds(dc.replace(plan, segments=segments), cell)


@pytest.mark.parametrize("step", [1e-310, 1e-160, 1e-12])
@pytest.mark.parametrize("velocity", [0.0, 1e-3, 1e30])
def test_steps_of_no_time(plan: FlatteningPlan, cell: Cell, step: float, velocity: float) -> None:
    """One more sample right after the first, with another velocity.

    The controller never gets it.
    """
    t = plan.segments[1].trajectory
    times = np.concatenate([[0.0, step], t.times[1:]])
    positions = np.concatenate([t.positions[:1], t.positions])
    velocities = np.concatenate([t.velocities[:1], np.full((1, 13), velocity), t.velocities[1:]])
    segments = list(plan.segments)
    segments[1] = dc.replace(segments[1], trajectory=Trajectory(times, positions, velocities))
    verdict = verify(dc.replace(plan, segments=tuple(segments)), cell)
    assert {v.kind for v in verdict.violations} <= {"sent", "velocity", "acceleration", "jerk"}


@pytest.mark.parametrize("value", [1e10, 3e38])
def test_positions_out_of_this_world(plan: FlatteningPlan, cell: Cell, value: float) -> None:
    t = plan.segments[1].trajectory
    positions = t.positions.copy()
    positions[7, 3] = value
    segments = list(plan.segments)
    segments[1] = dc.replace(segments[1], trajectory=Trajectory(t.times, positions, t.velocities))
    found = kinds(dc.replace(plan, segments=tuple(segments)), cell)
    assert {"position", "velocity", "acceleration", "jerk"} <= found


def test_times_in_milliseconds(plan: FlatteningPlan, cell: Cell) -> None:
    """Times of ms as s with the velocities as they were.

    Limits are broken, and nothing more is computed.
    """
    segments = []
    for segment in plan.segments:
        t = segment.trajectory
        segments.append(
            dc.replace(segment, trajectory=Trajectory(1e3 * t.times, t.positions, t.velocities))
        )
    found = kinds(dc.replace(plan, segments=tuple(segments)), cell)
    assert found & {"velocity", "position", "sent"}
    assert not found & {"clearance", "finger_table"}


def test_times_a_thousandth(plan: FlatteningPlan, cell: Cell) -> None:
    segments = []
    for segment in plan.segments:
        t = segment.trajectory
        segments.append(
            dc.replace(segment, trajectory=Trajectory(1e-3 * t.times, t.positions, t.velocities))
        )
    verdict = verify(dc.replace(plan, segments=tuple(segments)), cell)
    assert verdict.queries == 0 and "distances were not computed" in verdict.summary()
    assert {"velocity", "acceleration", "jerk"} <= {v.kind for v in verdict.violations}


def test_too_many_samples(plan: FlatteningPlan, cell: Cell) -> None:
    t = plan.segments[0].trajectory
    for count in (MOST_SAMPLES + 1, 200_000):
        times = np.linspace(0.0, t.duration, count)
        many = Trajectory(times, t.interpolant()(times), t.interpolant().derivative()(times))
        segments = (dc.replace(plan.segments[0], trajectory=many), *plan.segments[1:])
        verdict = verify(dc.replace(plan, segments=segments), cell)
        assert [violation.kind for violation in verdict.violations] == ["numbers"]
        assert f"cannot be verified within {MOST_SAMPLES}" in verdict.violations[0].message


def test_as_many_samples_as_may_be_end_in_time(plan: FlatteningPlan, cell: Cell) -> None:
    """The approach cut into pieces of a fifth of a millisecond: the controller takes whole ones."""
    t = plan.segments[0].trajectory
    times = np.linspace(0.0, t.duration, MOST_SAMPLES - 1000)
    many = Trajectory(times, t.interpolant()(times), t.interpolant().derivative()(times))
    segments = (dc.replace(plan.segments[0], trajectory=many), *plan.segments[1:])
    assert "jerk" in kinds(dc.replace(plan, segments=segments), cell)


def test_a_motion_that_wanders_without_end_is_given_up(plan: FlatteningPlan, cell: Cell) -> None:
    """Forty minutes of swinging about, within every limit, near the table's edge."""
    t = np.round(np.arange(0, 19_000) * 0.125, 3)
    start = plan.segments[0].trajectory.positions[0]
    phase = 2.0 * np.pi * 0.2 * t * np.minimum(1.0, t / 10.0)
    positions = np.tile(start, (len(t), 1))
    positions[:, [1, 7]] += (0.4 * (1.0 - np.cos(phase)))[:, None] * [1.0, -1.0]
    path = CubicSpline(t, positions, bc_type="clamped")
    wander = Trajectory(t, positions, path(t, 1))
    first = dc.replace(plan.segments[0], trajectory=wander, poses=(), contact=(0.0, 0.0))
    verdict = verify(dc.replace(plan, segments=(first,)), cell)
    given_up = [v.message for v in verdict.violations if "cannot be verified within" in v.message]
    assert len(given_up) == 1
    assert verdict.clearances == () and verdict.elsewhere == 0.0


# One robot.


def test_numbers_of_another_robot(plan: FlatteningPlan, cell: Cell) -> None:
    """A Denavit-Hartenberg length off by 20 mm, unchanged model files, and a forged hash."""
    rows = list(cell.robot.denavit_hartenberg)
    rows[1] = dc.replace(rows[1], a=rows[1].a + 0.020)
    other = dc.replace(cell, robot=dc.replace(cell.robot, denavit_hartenberg=rows))
    assert kinds(dc.replace(plan, robot_hash=other.robot_hash), other) == {"kinematics"}


def test_the_angles_of_a_tool() -> None:
    """From angles to axes and back, beyond the vertical too."""
    rng = np.random.default_rng(1)
    for _ in range(300):
        away = rng.uniform(-np.pi, np.pi)
        tilt, heading, roll = rng.uniform([0.0, -1.5, -1.5], [2.0, 1.5, 1.5])
        psi = away + heading
        z = np.array([np.cos(tilt) * np.cos(psi), np.cos(tilt) * np.sin(psi), -np.sin(tilt)])
        flat = np.array([np.sin(tilt) * np.cos(psi), np.sin(tilt) * np.sin(psi), np.cos(tilt)])
        y = np.cos(roll) * flat + np.sin(roll) * np.array([-np.sin(psi), np.cos(psi), 0.0])
        R = np.stack([np.cross(y, z), y, z], axis=1)[None]
        if abs(np.cos(tilt)) < 0.06:
            continue
        found = np.array(tool_angles(R, np.array([np.cos(away), np.sin(away)])))[:, 0]
        assert found == pytest.approx([tilt, heading, roll], abs=1e-9)
