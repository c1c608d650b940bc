"""The loop's judgement: which wrinkle next, with how many arms, and when to stop. Pure functions of values.

- Flat: no wrinkle asks for the sensor's halting pull, and none is higher than the scenario's halting height.
- The largest wrinkle first (or by another of `ordering`), with two arms; where there is no motion for it the next; then one arm, largest first.
- A grasp that missed is tried again some times, then the wrinkle is left aside.
- Two actions in a row that changed nothing: the next wrinkle; a third: one arm; a fourth: give up.
- What was left aside counts again once an action has changed something.
- Nothing usable in two looks in a row: stop.
"""

import dataclasses as dc
import math
from dataclasses import dataclass
from typing import Any, Self

from unwrinkle.flattening.messages import Shared
from unwrinkle.flattening.priority import flattened_together, highest_part, in_order
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.wrinkles.analysis import Analysis

#: Numbers of arms to try, in order, by the scenario's choice.
LEVELS = {"any": ("dual", "single"), "dual": ("dual",), "single": ("single",)}

#: Actions in a row that changed nothing, after which the wrinkle is left aside; one arm takes over; the loop gives up.
NEXT_WRINKLE, ONE_ARM, GIVE_UP = 2, 3, 4

#: Looks in a row that showed nothing usable, after which the loop stops.
BLIND_LOOKS = 2

#: A single layer of a garment is not thicker than this, m: what a sensor must tell from the table to see a flat one.
THICKEST_LAYER = 0.003

#: A garment with more than this share of its seen area beyond the table's edges is not worked on.
MOST_BEYOND = 0.5
#: A garment with more than this share of its outline along the table's edges hangs over them: not flat.
MOST_ALONG_EDGE = 0.22

#: Heights below this many standard deviations of a sensor's reading are no reason to pull.
NOISES = 2.0

#: A wrinkle is the same in two looks if its middle moved less than this, m, and it turned less than this, rad.
SAME_PLACE, SAME_ANGLE = 0.05, 0.6


@dataclass(frozen=True)
class SeenWrinkle:
    """What counts of a wrinkle.

    Attributes:
        index: in the analysis, largest first.
        centre: x, y in the world, m.
        angle: of its direction, rad.
        volume: argument of Eq. 4's logarithms, length times mean of width times height, mm^3.
        pull: Eq. 5, m.
        height: of its highest part over the line between its feet, m.
        length: along its ridge line, m.
        together: volume of all that a pull across it works on, mm^3; see `ordering`.
    """

    index: int
    centre: tuple[float, float]
    angle: float
    volume: float
    pull: float
    height: float
    length: float = 0.0
    together: float = 0.0


@dataclass(frozen=True)
class Sight(Shared):
    """What counts of an analysis.

    Attributes:
        wrinkles: largest first.
        halting_pull: of the sensor, m.
        noise: standard deviation of the sensor's readings, m.
        beyond: share of the garment's seen area beyond the table's edges.
        along_edge: share of its outline along the table's edges.
    """

    wrinkles: tuple[SeenWrinkle, ...] = ()
    halting_pull: float = 0.005
    noise: float = 0.0
    beyond: float = 0.0
    along_edge: float = 0.0

    def worth_pulling(self, halting_height: float) -> list[SeenWrinkle]:
        """Wrinkles that ask for the halting pull or are higher than this (m), largest first.

        What is not higher than the sensor's noise allows to tell (`NOISES`) is not high.
        """
        halting_height = max(halting_height, NOISES * self.noise)
        return [
            wrinkle
            for wrinkle in self.wrinkles
            if wrinkle.pull >= self.halting_pull or wrinkle.height > halting_height
        ]

    def volumes(self, halting_height: float) -> tuple[float, float]:
        """Greatest volume and sum of the volumes of the wrinkles worth pulling, mm^3.

        The low ones do not count: from look to look the sensor's noise makes some and takes others away.
        """
        volumes = [wrinkle.volume for wrinkle in self.worth_pulling(halting_height)]
        return max(volumes, default=0.0), sum(volumes)


def sight_of(analysis: Analysis) -> Sight:
    """What counts of an analysis."""
    together = flattened_together(analysis.wrinkles, analysis.section)
    return Sight(
        tuple(
            SeenWrinkle(
                index=index,
                centre=(float(wrinkle.centre[0]), float(wrinkle.centre[1])),
                angle=math.atan2(wrinkle.direction[1], wrinkle.direction[0]),
                volume=math.exp(wrinkle.volume_score),
                pull=wrinkle.pull_distance(analysis.mode),
                height=highest_part(wrinkle),
                length=wrinkle.length,
                together=together[index],
            )
            for index, wrinkle in enumerate(analysis.wrinkles)
        ),
        analysis.profile.halting_pull,
        analysis.profile.depth_noise,
        analysis.share_beyond_table,
        analysis.share_along_edge,
    )


@dataclass(frozen=True)
class Pull(Shared):
    """Pull a wrinkle.

    Attributes:
        wrinkle: which.
        arms: `dual` or `single`.
    """

    wrinkle: SeenWrinkle
    arms: str


@dataclass(frozen=True)
class Stop(Shared):
    """Do no more.

    Attributes:
        flat: because the garment is flat.
        reason: in words.
    """

    flat: bool
    reason: str


@dataclass(frozen=True)
class Tried(Shared):
    """A wrinkle that was left aside: where it is, with how many arms it was tried, and why no more."""

    centre: tuple[float, float]
    angle: float
    arms: str
    reason: str

    def is_of(self, wrinkle: SeenWrinkle) -> bool:
        """Whether that wrinkle is this one."""
        return _same(self.centre, self.angle, wrinkle)


@dataclass(frozen=True)
class Pulled(Shared):
    """The last action.

    Attributes:
        centre, angle, arms: of what was pulled.
        largest, total: volumes of what was worth pulling before it, mm^3; see `Sight.volumes`.
        missed: a gripper had no cloth.
        judged: whether its effect was seen already.
    """

    centre: tuple[float, float]
    angle: float
    arms: str
    largest: float
    total: float
    missed: bool = False
    judged: bool = False


@dataclass(frozen=True)
class Memory(Shared):
    """What the loop remembers from look to look.

    Attributes:
        looks: taken.
        blind: looks in a row that showed nothing usable.
        actions: motions carried out, missed grasps included.
        idle: actions in a row that changed nothing.
        misses: grasps in a row that missed at one wrinkle.
        tried: wrinkles left aside.
        last: the last action.
    """

    looks: int = 0
    blind: int = 0
    actions: int = 0
    idle: int = 0
    misses: int = 0
    tried: tuple[Tried, ...] = ()
    last: Pulled | None = None

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, strings and lists."""
        return dc.asdict(self)

    @classmethod
    def from_json(cls, data: Any) -> Self:
        """Rebuild what `to_json` gave.

        Raises:
            InputError: it is no such thing.
        """
        try:
            counts = {
                name: int(data[name]) for name in ("looks", "blind", "actions", "idle", "misses")
            }
            if min(counts.values()) < 0 or set(data) != {f.name for f in dc.fields(cls)}:
                raise ValueError("its fields")
            last = None if data["last"] is None else Pulled(**_placed(data["last"]))
            tried = tuple(Tried(**_placed(item)) for item in data["tried"])
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"the loop's memory is damaged ({error}); begin a new run, without --resume"
            ) from None
        return cls(tried=tried, last=last, **counts)


def looked(memory: Memory, sight: Sight, rules: LoopSettings) -> Memory:
    """Remember a look that showed the garment, and what the last action had changed.

    An action has changed something if the largest wrinkle, or all that are worth pulling together, have lost at least
    the share `least_gain` of their volume: of two alike wrinkles one may go without the largest becoming smaller.
    """
    memory = dc.replace(memory, looks=memory.looks + 1, blind=0)
    last = memory.last
    if last is None or last.judged:
        return memory
    memory = dc.replace(memory, last=dc.replace(last, judged=True))
    if last.missed:
        return memory
    kept = 1.0 - rules.least_gain
    largest, total = sight.volumes(rules.halting_height)
    if largest <= kept * last.largest or total <= kept * last.total:
        return dc.replace(memory, idle=0, misses=0, tried=())
    memory = dc.replace(memory, idle=memory.idle + 1)
    if memory.idle < NEXT_WRINKLE:
        return memory
    reason = f"{memory.idle} actions in a row changed nothing"
    return _aside(memory, last.centre, last.angle, last.arms, reason)


def blinded(
    memory: Memory, reason: str, *, empty: bool = False, unseen: float = 0.0
) -> tuple[Memory, Stop | None]:
    """Remember a look that showed nothing usable; and whether that ends the loop.

    A sensor that does not tell a single layer from the table sees no garment that is flat. So a table that is
    empty to it, where it saw a garment that was then pulled by millimetres, has a flat one on it.

    Args:
        memory: before.
        reason: why nothing was seen.
        empty: the table was seen, and nothing on it.
        unseen: height of a garment that the sensor does not tell from the table, m.
    """
    memory = dc.replace(memory, looks=memory.looks + 1, blind=memory.blind + 1)
    if memory.blind < BLIND_LOOKS:
        return memory, None
    if empty and unseen > THICKEST_LAYER and memory.last is not None:
        return memory, Stop(
            True,
            f"flat as far as this sensor sees: nothing stands {1e3 * unseen:.1f} mm above the table "
            "any more",
        )
    return memory, Stop(False, f"nothing usable seen in {memory.blind} looks: {reason}")


def decide(sight: Sight, memory: Memory, rules: LoopSettings) -> Pull | Stop:
    """Say what to do about what was seen."""
    if sight.beyond > MOST_BEYOND:
        return Stop(
            False,
            f"{sight.beyond:.0%} of the garment lies beyond the table's edges, at most "
            f"{MOST_BEYOND:.0%} may; lay it back",
        )
    worth = sight.worth_pulling(rules.halting_height)
    if not worth and sight.along_edge > MOST_ALONG_EDGE:
        return Stop(
            False,
            f"{sight.along_edge:.0%} of the garment's outline runs along the table's edge, at most "
            f"{MOST_ALONG_EDGE:.0%} may; it hangs over, lay it back",
        )
    if not worth:
        pull = max((wrinkle.pull for wrinkle in sight.wrinkles), default=0.0)
        height = max((wrinkle.height for wrinkle in sight.wrinkles), default=0.0)
        return Stop(
            True,
            f"flat: {len(sight.wrinkles)} wrinkles, the largest pull {1e3 * pull:.1f} mm of "
            f"{1e3 * sight.halting_pull:.1f} mm, the highest {1e3 * height:.1f} mm of "
            f"{1e3 * rules.halting_height:.1f} mm",
        )
    if memory.actions >= rules.actions:
        return Stop(
            False,
            f"not flat after {memory.actions} actions: {len(worth)} wrinkles are left, the largest "
            f"asks for a pull of {1e3 * worth[0].pull:.1f} mm and is "
            f"{1e3 * worth[0].height:.1f} mm high; allow more actions",
        )
    levels = LEVELS[rules.arms]
    if memory.idle >= ONE_ARM:
        levels = levels[1:]
    if memory.idle >= GIVE_UP or not levels:
        return Stop(False, f"{memory.idle} actions in a row changed nothing{_reasons(memory)}")
    ordered = in_order(worth, rules.order)
    for arms in levels:
        for wrinkle in ordered:
            if not any(item.arms == arms and item.is_of(wrinkle) for item in memory.tried):
                return Pull(wrinkle, arms)
    return Stop(
        False, f"no motion for any of the {len(worth)} wrinkles that are left{_reasons(memory)}"
    )


def unplannable(memory: Memory, pull: Pull, reason: str) -> Memory:
    """Remember that there is no verified motion for a wrinkle."""
    return _aside(memory, pull.wrinkle.centre, pull.wrinkle.angle, pull.arms, reason)


def carried_out(
    memory: Memory, pull: Pull, sight: Sight, rules: LoopSettings, *, missed: bool
) -> Memory:
    """Remember an action.

    Args:
        memory: before.
        pull: what was decided.
        sight: what it was decided on.
        rules: of the loop.
        missed: a gripper had no cloth; nothing was pulled.
    """
    wrinkle = pull.wrinkle
    again = (
        memory.last is not None
        and memory.last.missed
        and _same(memory.last.centre, memory.last.angle, wrinkle)
    )
    misses = (memory.misses if again else 0) + 1 if missed else 0
    largest, total = sight.volumes(rules.halting_height)
    memory = dc.replace(
        memory,
        actions=memory.actions + 1,
        misses=misses,
        last=Pulled(wrinkle.centre, wrinkle.angle, pull.arms, largest, total, missed=missed),
    )
    if misses < rules.grasp_attempts:
        return memory
    reason = f"the grasp missed {misses} times"
    return dc.replace(_aside(memory, wrinkle.centre, wrinkle.angle, pull.arms, reason), misses=0)


def _aside(
    memory: Memory, centre: tuple[float, float], angle: float, arms: str, reason: str
) -> Memory:
    return dc.replace(memory, tried=(*memory.tried, Tried(centre, angle, arms, reason)))


def _same(centre: tuple[float, float], angle: float, wrinkle: SeenWrinkle) -> bool:
    turned = abs((angle - wrinkle.angle + 0.5 * math.pi) % math.pi - 0.5 * math.pi)
    return math.dist(centre, wrinkle.centre) < SAME_PLACE and turned < SAME_ANGLE


def _reasons(memory: Memory) -> str:
    """The last reasons why wrinkles were left aside, each once."""
    reasons = list(dict.fromkeys(f"{item.arms}: {item.reason}" for item in memory.tried))
    return "".join(f"; {reason}" for reason in reasons[-4:])


def _placed(data: dict[str, Any]) -> dict[str, Any]:
    x, y = (float(value) for value in data["centre"])
    kept = [key for key in ("angle", "largest", "total") if key in data]
    numbers: dict[str, Any] = {key: float(data[key]) for key in kept}
    if not all(math.isfinite(value) for value in (x, y, *numbers.values())):
        raise ValueError("a number that is not finite")
    return {**data, **numbers, "centre": (x, y)}
