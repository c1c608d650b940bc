"""Summarise a run log in rows of text."""

from collections.abc import Iterator

import numpy as np

from unwrinkle.hardware.run_log.reader import RunLogRecords


def summary_rows(records: RunLogRecords) -> Iterator[tuple[str, str]]:
    """Yield name and text of each property of a log."""
    header = records.header
    yield "begun", str(header.get("begun", "unknown"))
    yield "site", str(header.get("site", "unknown"))
    yield "plan", str(header.get("plan_hash", "unknown"))
    verdict = header.get("verdict")
    if isinstance(verdict, dict):
        yield "verdict", "verified" if verdict.get("passed") else "NOT verified"
    yield "speed", str(header.get("speed", "unknown"))
    yield "lasts", f"{records.end - records.begin:.2f} s"
    sent, seen = records.commanded, records.measured
    yield "points sent", str(len(sent.times))
    yield "feedback", _feedback(seen.times)
    if len(seen.times) > 1:
        steps = np.abs(np.diff(seen.positions, axis=0))
        if np.isfinite(steps).any():
            yield (
                "axes moved",
                f"{int(np.sum(np.nanmax(steps, axis=0) > 1e-3))} of {steps.shape[1]}",
            )
    states = [status.state for status in records.statuses]
    changes = [state for i, state in enumerate(states) if i == 0 or state != states[i - 1]]
    yield "states", " > ".join(changes) or "none"
    results = [event for event in records.events if event.kind == "result"]
    if results:
        outcome = str(results[-1].data.get("outcome", ""))
        yield "result", f"{outcome}: {results[-1].text}" if outcome != results[-1].text else outcome
    else:
        yield "result", "none: the program ended before the execution did"
    yield "last line", "incomplete, as after a crash" if records.cut else "complete"


def event_rows(records: RunLogRecords) -> Iterator[tuple[str, str, str]]:
    """Yield time after the log's start, kind and text of every event."""
    for event in records.events:
        yield f"{event.time - records.begin:.3f} s", event.kind, event.text


def _feedback(times: np.ndarray) -> str:
    if len(times) < 2:
        return f"{len(times)} sets"
    gaps = np.diff(times)
    return (
        f"{len(times)} sets, {1.0 / max(float(np.mean(gaps)), 1e-9):.1f} per second, longest gap "
        f"{1e3 * float(gaps.max()):.0f} ms"
    )
