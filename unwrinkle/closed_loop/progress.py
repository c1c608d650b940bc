"""Print the progress of a run: a line for every stage with its time."""

from collections.abc import Callable

from unwrinkle.closed_loop.run import Seconds
from unwrinkle.closed_loop.station_view import StationView
from unwrinkle.flattening.state import Mode, SupervisorState

#: Activity in each state, for the status line.
DOING = {
    Mode.LOOK: "looking",
    Mode.PERCEIVE: "matching the pair and finding wrinkles",
    Mode.DECIDE: "deciding",
    Mode.PLAN: "planning",
    Mode.CONFIRM: "verifying the plan",
    Mode.MOVE: "moving",
    Mode.GRIP: "gripping",
    Mode.RETREAT: "going back",
    Mode.HOLD: "stopping",
}


class ProgressWatcher:
    """Watcher that prints the progress."""

    def __init__(self, say: Callable[[str], None], doing: Callable[[str], None]) -> None:
        """Set the two outputs.

        Args:
            say: function that prints a finished line.
            doing: function that updates the status line.
        """
        self._say, self._doing = say, doing

    def update(
        self, before: SupervisorState, now: SupervisorState, station: StationView, seconds: Seconds
    ) -> None:
        """Print what is new; see `run.Watcher`."""
        if now.mode == before.mode:
            return
        for line in _lines(before, now, station, seconds):
            self._say(line)
        if now.mode in DOING:
            step = f": {now.steps[0].name}" if now.steps else ""
            self._doing(f"look {now.action.look}, {DOING[now.mode]}{step}")


def _lines(
    before: SupervisorState, now: SupervisorState, station: StationView, seconds: Seconds
) -> list[str]:
    action = now.action
    spent = seconds.of(before.mode)
    if before.mode == Mode.LOOK and now.mode == Mode.PERCEIVE:
        truth = station.truth()
        known = ""
        if truth is not None:
            known = (
                f" (true coverage {truth['coverage']:.1%}, true height {1e3 * truth['height']:.1f} "
                "mm)"
            )
        return [f"look {action.look}", f"  picture       {spent:6.2f} s{known}"]
    if before.mode == Mode.PERCEIVE and now.mode == Mode.DECIDE:
        return _found(now, seconds)
    if action is before.action or action.look == before.action.look:
        refused = [
            f"  no plan       {spent:6.2f} s: wrinkle {refusal.wrinkle + 1}, {refusal.arms}: "
            f"{refusal.reason}"
            for refusal in action.refusals[len(before.action.refusals) :]
        ]
        if refused:
            return refused
    if before.mode == Mode.PLAN and now.mode == Mode.CONFIRM:
        return _planned(now, spent)
    if before.mode == Mode.CONFIRM and now.mode in (Mode.APPROVE, Mode.MOVE):
        verified = action.verified
        verdict = None if verified is None else verified.verdict
        return [] if verdict is None else [f"  verification  {spent:6.2f} s: {verdict.summary()}"]
    if now.finished is not None and now.finished is not before.finished:
        moved = seconds.of(Mode.MOVE, Mode.GRIP, Mode.RETREAT)
        what = now.finished.outcome
        reason = f", {now.finished.reason}" if now.finished.reason else ""
        return [f"  action        {moved:6.2f} s: {what}{reason}"]
    return []


def _found(now: SupervisorState, seconds: Seconds) -> list[str]:
    action = now.action
    perceived, analysed, observation = action.perceived, action.analysed, action.observation
    lines = []
    if perceived is not None:
        lines.append(f"  range map     {perceived.seconds:6.2f} s")
    if analysed is not None and observation is not None:
        wrinkles = observation.features.wrinkles
        text = f"{len(wrinkles)} wrinkles"
        if wrinkles:
            first = wrinkles[0]
            text += (
                f", the largest is {1e3 * first.height:.1f} mm high and needs a pull of "
                f"{1e3 * first.pull:.1f} mm"
            )
        lines.append(f"  wrinkles      {analysed.seconds:6.2f} s: {text}")
    return lines


def _planned(now: SupervisorState, spent: float) -> list[str]:
    planned, pull = now.action.planned, now.action.pull
    if planned is None or planned.result is None or planned.result.plan is None or pull is None:
        return []
    plan = planned.result.plan
    pulls = [
        f"{name} {1e3 * arm.share * plan.target.hands[arm.side].pull_distance:.1f} mm"
        for name, arm in zip(("right", "left"), plan.arms, strict=True)
        if arm is not None
    ]
    what = f"wrinkle {pull.wrinkle.index + 1}, {', '.join(pulls)}"
    return [f"  plan          {spent:6.2f} s: {what}, motion {plan.motion_time:.1f} s"]
