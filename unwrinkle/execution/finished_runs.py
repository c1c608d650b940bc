"""Record of plans that were run to their end.

During commissioning the first run of a plan is slow.
"""

import datetime
import json
import os
from pathlib import Path

from unwrinkle.models.errors import InputError


def state_folder() -> Path:
    """Return the folder of the user's program state.

    It is $XDG_STATE_HOME/unwrinkle, or ~/.local/state/unwrinkle.
    """
    base = os.environ.get("XDG_STATE_HOME", "")
    return (Path(base) if base else Path.home() / ".local" / "state") / "unwrinkle"


class FinishedRuns:
    """File with one line per finished run: site, plan's hash, speed, time."""

    def __init__(self, path: Path | None = None) -> None:
        """Use a file; the one in the user's state folder if left out."""
        self.path = state_folder() / "finished_runs.jsonl" if path is None else path

    def count(self, site: str, plan_hash: str) -> int:
        """Count the finished runs of a plan at a site; unreadable lines do not count."""
        try:
            lines = self.path.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError:
            return 0
        return sum(_is_of(line, site, plan_hash) for line in lines)

    def add(self, site: str, plan_hash: str, speed: float) -> None:
        """Append a finished run.

        Raises:
            InputError: the file cannot be written.
        """
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        record = {"site": site, "plan": plan_hash, "speed": speed, "time": now}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(record) + "\n")
        except OSError as error:
            raise InputError(
                f"{self.path}: the finished run cannot be recorded ({error.strerror or error}); "
                "the plan's next run will count as its first"
            ) from None


def _is_of(line: str, site: str, plan_hash: str) -> bool:
    try:
        record = json.loads(line)
    except ValueError:
        return False
    return (
        isinstance(record, dict) and record.get("site") == site and record.get("plan") == plan_hash
    )
