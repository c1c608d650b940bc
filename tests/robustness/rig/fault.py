"""A fault: what is injected, what must follow, and a case that can fail."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.robustness.rig.increments import Increments

#: What a result says where nothing was judged.
MISSING = "not there yet"


class Different(Exception):
    """A promise was not kept in a way that leaves nothing more to look at; the message says how."""


@dataclass(frozen=True)
class FaultResult:
    """How one fault ended.

    Attributes:
        id: as the field's catalogue counts: N, S, C, P, V, G, H or F and a number.
        fault: in a few words.
        injected: how it was injected.
        must: what must happen, in the catalogue's words.
        outcome: the promises that were looked at and held; where one did not, what differed.
        survived: every promise held.
        message: what the user reads.
        limit_violations: samples that were sent beyond a limit.
        moved: greatest angle that an axis moved before it was commanded to, rad.
        increments: what the controller ran of plans.
        seconds: wall clock.
    """

    id: str
    fault: str
    injected: str
    must: str
    outcome: str
    survived: bool
    message: str = ""
    limit_violations: int = 0
    moved: float = 0.0
    increments: tuple[Increments, ...] = ()
    seconds: float = 0.0


@dataclass
class Case:
    """One injection under way: collects what held, what differed and what the user read.

    Attributes:
        folder: empty, for files.
        seed: of every random choice.
        kept: promises that held.
        broken: promises that did not, each with what was found.
        messages: what the user read, in order.
        limit_violations: samples that were sent beyond a limit.
        moved_before_command: greatest angle that an axis moved before it was commanded to, rad.
        increments: what the controller ran of plans.
    """

    folder: Path
    seed: int = 0
    kept: list[str] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)
    limit_violations: int = 0
    moved_before_command: float = 0.0
    increments: list[Increments] = field(default_factory=list)

    @property
    def rng(self) -> np.random.Generator:
        """A generator from the seed, the same at every call."""
        return np.random.default_rng(self.seed)

    def expect(self, holds: object, promise: str, found: object = "") -> bool:
        """Note whether a promise holds; `found` tells what was there instead."""
        if holds:
            if promise not in self.kept:
                self.kept.append(promise)
        else:
            self.broken.append(f"NOT: {promise}" + (f" (found: {found})" if found != "" else ""))
        return bool(holds)

    def need(self, holds: object, promise: str, found: object = "") -> None:
        """As `expect`, where nothing more can be looked at without it.

        Raises:
            Different: it does not hold.
        """
        if not self.expect(holds, promise, found):
            raise Different

    def reads(self, message: str, *words: str) -> None:
        """Note what the user reads, and expect words in it (case aside)."""
        text = " ".join(str(message).split())
        if text and text not in self.messages:
            self.messages.append(text)
        for word in words:
            self.expect(
                word.lower() in text.lower(), f"the message says '{word}'", text or "nothing"
            )

    def moved(self, angle: float) -> None:
        """Note how far an axis moved although nobody had commanded it, rad."""
        self.moved_before_command = max(self.moved_before_command, float(angle))
        self.expect(angle == 0.0, "nothing moves before it is commanded to", f"{angle:.3g} rad")

    def violations(self, found: list[str]) -> None:
        """Note samples that were sent beyond a limit."""
        self.limit_violations += len(found)
        self.expect(not found, "nothing beyond a limit was sent", "; ".join(found[:3]))


@dataclass(frozen=True)
class Fault:
    """One fault of the catalogue.

    Attributes:
        id: as of its result.
        fault: in a few words.
        injected: how it is injected.
        must: what must happen, in the catalogue's words.
        play: injects it and says to the case what it found.
    """

    id: str
    fault: str
    injected: str
    must: str
    play: Callable[[Case], None]

    def run(self, folder: Path, seed: int = 0) -> FaultResult:
        """Inject the fault and judge; an unforeseen exception is a promise that was not kept.

        Args:
            folder: for files; made, and empty before.
            seed: of every random choice.
        """
        folder.mkdir(parents=True, exist_ok=True)
        case = Case(folder, seed)
        clock = time.perf_counter()
        try:
            self.play(case)
        except Different:
            pass
        except ImportError as error:
            case.broken.append(f"NOT: {MISSING} ({error})")
        except Exception as error:  # noqa: BLE001  a fault reports, whatever comes
            case.broken.append(
                f"NOT: no exception escapes (found: {type(error).__name__}: {error})"
            )
        if not case.kept and not case.broken:
            case.broken.append("NOT: the case looked at something (found: nothing)")
        return FaultResult(
            self.id,
            self.fault,
            self.injected,
            self.must,
            "; ".join(case.broken or case.kept),
            not case.broken and case.limit_violations == 0,
            " / ".join(case.messages),
            case.limit_violations,
            case.moved_before_command,
            tuple(case.increments),
            time.perf_counter() - clock,
        )
