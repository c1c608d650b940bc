"""The controller's rules: the path is never left, holds come to rest, the override keeps limits,
refusals.
"""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.trajectory import SampledCubic
from unwrinkle.simulation.arms.trajectory_player import (
    PlayerLimits,
    PlayerState,
    TrajectoryPlayer,
)

AXES = ("s", "l", "t")
STEP = 0.004
LIMITS = PlayerLimits(np.full(3, -3.0), np.full(3, 3.0), np.full(3, 4.0), np.full(3, 12.0))
PLAYER = TrajectoryPlayer(LIMITS, AXES)


def move(start: Array, way: Array, duration: float, samples: int = 60) -> SampledCubic:
    """A rest-to-rest motion along a line, by a quintic, as planned ones are smooth."""
    u = np.linspace(0.0, 1.0, samples)
    share = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    rate = 30.0 * u**2 * (1.0 - u) ** 2 / duration
    return SampledCubic(u * duration, start + share[:, None] * way, rate[:, None] * way)


def slowest(way: Array) -> float:
    """Shortest duration of `move` that keeps the limits."""
    most = np.abs(way).max()
    return float(max(1.875 * most / 4.0, np.sqrt(5.7736 * most / 12.0)) * 1.01)


def turned(seed: int = 0, length: float = 1.0) -> tuple[Array, Array, SampledCubic]:
    rng = np.random.default_rng(seed)
    start, way = rng.uniform(-1.0, 1.0, 3), length * rng.uniform(-1.5, 1.5, 3)
    return start, way, move(start, way, slowest(way))


def step(
    state: PlayerState, override: float = 1.0, player: TrajectoryPlayer = PLAYER
) -> PlayerState:
    """One period of a robot that follows exactly."""
    q, v = player.reference(state)
    return player.advance(state, STEP, override, q, v)


def begun(track: SampledCubic, start: Array) -> PlayerState:
    state = PLAYER.accept(PLAYER.at_rest(start), 1, track, start, "move")
    assert (state.mode, state.reason) == (MotionMode.RUNNING, "")
    return state


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 1000),
    overrides=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8),
    held=st.integers(0, 300),
)
def test_it_never_leaves_the_path(seed: int, overrides: list[float], held: int) -> None:
    start, way, track = turned(seed)
    state = begun(track, start)
    shares = []
    for k in range(400):
        if k == held:
            state = PLAYER.accept(state, 2, None, start)
        state = step(state, overrides[(k // 25) % len(overrides)])
        q = PLAYER.reference(state)[0]
        share = float((q - start) @ way / (way @ way))
        assert np.abs(q - start - share * way).max() < 1e-9
        shares.append(share)
    assert min(shares) >= -1e-9 and max(shares) <= 1.0 + 1e-9
    assert (np.diff(shares) >= -1e-9).all()  # and never goes back


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 1000), when=st.floats(0.0, 1.0))
def test_a_hold_comes_to_rest_within_the_limits(seed: int, when: float) -> None:
    start, _, track = turned(seed)
    state = begun(track, start)
    for _ in range(int(when * track.duration / STEP)):
        state = step(state)
    state = PLAYER.accept(state, 2, None, start)
    speeds = [PLAYER.reference(state)[1]]
    steps = 0
    while state.mode == MotionMode.HOLDING:
        state = step(state)
        speeds.append(PLAYER.reference(state)[1])
        steps += 1
        assert steps * STEP <= 2.0 + STEP  # 1 / least_braking
    assert state.mode == MotionMode.IDLE and state.completed == state.command == 2
    assert (speeds[-1] == 0.0).all() and "hold commanded" in state.reason
    # As promised: the limit, and where the path itself uses it up, least_braking times the speed
    # more.
    most = np.abs(np.diff(speeds, axis=0)).max(initial=0.0) / STEP
    allowance = PLAYER.settings.least_braking * 4.0
    assert most <= 12.0 + allowance + 0.5  # 0.5: the jerk within one step


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 1000), override=st.floats(0.2, 1.0), second=st.floats(0.2, 1.0))
def test_the_override_keeps_speed_and_acceleration(
    seed: int, override: float, second: float
) -> None:
    start, _, track = turned(seed)
    state = begun(track, start)
    speeds = []
    for k in range(4000):
        state = step(state, override if k < 40 else second)
        speeds.append(PLAYER.reference(state)[1])
        if state.mode == MotionMode.IDLE:
            break
    assert state.completed == 1
    assert np.abs(speeds).max() <= 4.0
    slowing = PLAYER.settings.least_braking * 4.0 if second < override else 0.0
    assert np.abs(np.diff(speeds, axis=0)).max() / STEP <= 12.0 + slowing + 0.5


def test_at_full_speed_it_keeps_the_plans_time() -> None:
    start, way, track = turned(3)
    state = begun(track, start)
    for k in range(1, 60):
        state = step(state)
        assert state.s == pytest.approx(k * STEP)
    np.testing.assert_allclose(PLAYER.reference(state)[0], track.at(59 * STEP)[0])
    while state.mode == MotionMode.RUNNING:
        state = step(state)
    np.testing.assert_allclose(PLAYER.reference(state)[0], start + way)
    assert state.completed == 1 and state.reason == ""


def test_an_override_of_zero_pauses_and_goes_on() -> None:
    start, _, track = turned(4)
    state = begun(track, start)
    for k in range(400):
        state = step(state, 1.0 if k < 50 else 0.0)
    assert state.mode == MotionMode.RUNNING and state.rate == 0.0 and 0.0 < state.s < track.duration
    while state.mode == MotionMode.RUNNING:
        state = step(state)
    assert state.completed == 1


@pytest.mark.parametrize("override", [np.nan, -0.1, 1.1, np.inf])
def test_an_absurd_override_holds(override: float) -> None:
    start, _, track = turned(5)
    state = step(step(begun(track, start)), override)
    assert state.mode == MotionMode.HOLDING and "override" in state.reason
    while state.mode == MotionMode.HOLDING:
        state = step(state, override)
    assert state.mode == MotionMode.IDLE and state.completed == 0


def _bad(kind: str, start: Array) -> SampledCubic:
    way = np.array([1.0, -0.5, 0.3])
    track = move(start, way, slowest(way))
    positions, velocities = track.positions.copy(), track.velocities.copy()
    if kind == "not finite":
        velocities[7, 1] = np.nan
    elif kind == "off its start":
        positions += 2e-3
    elif kind == "at rest":
        velocities[-1] = 0.1
    elif kind == "position of t":
        return move(start, np.array([0.0, 0.0, 4.2]), 9.0)
    elif kind == "velocity of s":
        return move(start, np.array([2.0, 0.0, 0.0]), 0.9)
    elif kind == "acceleration of s":
        return move(start, np.array([0.5, 0.0, 0.0]), 0.4)
    elif kind == "axes":
        positions, velocities = positions[:, :2], velocities[:, :2]
    return SampledCubic(track.times, positions, velocities)


@pytest.mark.parametrize(
    "kind",
    [
        "not finite",
        "off its start",
        "at rest",
        "position of t",
        "velocity of s",
        "acceleration of s",
        "axes",
    ],
)
def test_refusals_state_their_reason_and_move_nothing(kind: str) -> None:
    start = np.array([0.2, 0.1, -0.7])
    before = PLAYER.at_rest(start)
    state = PLAYER.accept(before, 1, _bad(kind, start), start)
    assert state.mode == MotionMode.IDLE and state.command == 1 and state.completed == 0
    assert "refused" in state.reason and kind in state.reason
    assert (PLAYER.reference(step(state))[0] == start).all()


def test_between_samples_counts_too() -> None:
    times = np.array([0.0, 0.5, 1.0])
    positions = np.array([[0.0] * 3, [0.9, 0.0, 0.0], [0.0] * 3])
    found = SampledCubic(times, positions, np.zeros((3, 3))).extremes()
    assert found.speed[0] == pytest.approx(1.5 * 0.9 / 0.5)  # samples say 0
    assert found.acceleration[0] == pytest.approx(6.0 * 0.9 / 0.25)
    assert (found.lower[0], found.upper[0]) == (0.0, 0.9)
    swinging = SampledCubic(np.array([0.0, 1.0]), np.zeros((2, 1)), np.array([[1.0], [1.0]]))
    found = swinging.extremes()
    assert found.upper[0] == pytest.approx(np.sqrt(3.0) / 18.0)
    assert found.lower[0] == pytest.approx(-found.upper[0])


def test_a_follow_up_is_queued_only_from_the_end() -> None:
    start, way, track = turned(6)
    state = begun(track, start)
    back = move(start + way, -way, slowest(way))
    elsewhere = PLAYER.accept(state, 2, track, start)
    assert elsewhere.mode == MotionMode.RUNNING and "another one runs" in elsewhere.reason
    state = PLAYER.accept(elsewhere, 3, back, start)
    assert state.reason == "" and state.queued is not None
    assert "waits already" in PLAYER.accept(state, 4, back, start).reason
    while state.mode == MotionMode.RUNNING:
        state = step(state)
    assert state.completed == 3
    np.testing.assert_allclose(PLAYER.reference(state)[0], start)


def test_a_number_seen_before_is_no_new_command() -> None:
    start, _, track = turned(7)
    state = begun(track, start)
    assert PLAYER.accept(state, 1, None, start) is state
    assert PLAYER.accept(state, 0, track, start) is state


def test_a_hold_at_rest_is_done_at_once_and_braking_refuses() -> None:
    start, _, track = turned(8)
    state = PLAYER.accept(PLAYER.at_rest(start), 1, None, start)
    assert (state.mode, state.completed, state.reason) == (MotionMode.IDLE, 1, "")
    state = begun(track, start)
    for _ in range(40):
        state = step(state)
    state = PLAYER.accept(state, 2, None, start)
    refused = PLAYER.accept(state, 3, track, start)
    assert refused.mode == MotionMode.HOLDING and "braking" in refused.reason


def test_a_robot_that_does_not_follow_is_a_fault_that_stays() -> None:
    start, _, track = turned(9)
    state = begun(track, start)
    for _ in range(60):
        state = PLAYER.advance(state, STEP, 1.0, start, np.zeros(3))
    assert state.mode == MotionMode.FAULT and "following error" in state.reason
    for _ in range(600):
        state = step(state)
    assert state.trajectory is None
    assert "in fault" in PLAYER.accept(state, 2, track, start).reason


def test_a_robot_that_does_not_arrive_is_a_fault() -> None:
    start, _, track = turned(10)
    state = begun(track, start)
    for _ in range(2000):
        q, v = PLAYER.reference(state)
        state = PLAYER.advance(state, STEP, 1.0, q + 2e-3, v)
    assert (
        state.mode == MotionMode.FAULT
        and "mrad off the end" in state.reason
        and state.completed == 0
    )


def test_bad_shapes_are_errors() -> None:
    with pytest.raises(InputError, match="increase"):
        SampledCubic(np.array([0.0, 0.0]), np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(InputError, match="velocities"):
        SampledCubic(np.array([0.0, 1.0]), np.zeros((2, 3)), np.zeros((2, 2)))
    with pytest.raises(InputError, match="must be"):
        SampledCubic(np.array([0.0]), np.zeros((1, 3)), np.zeros((1, 3)))
    with pytest.raises(InputError, match="needs 3"):
        TrajectoryPlayer(dc.replace(LIMITS, velocity=np.zeros(2)), AXES)
    with pytest.raises(InputError, match="no finite posture"):
        PLAYER.at_rest([0.0, np.nan, 0.0])
