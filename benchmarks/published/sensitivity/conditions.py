"""The conditions of the benchmark: each changes one thing about the default loop."""

from dataclasses import dataclass, field
from typing import Any

from benchmarks.harness.trials import Trial
from unwrinkle.models.cloth import load_material
from unwrinkle.models.scenario import Scenario

WORK = "benchmarks.published.loop_trials:flattened"
#: Most actions of a run.
ACTIONS, QUICK_ACTIONS = 10, 2
#: What looks: the stereo head; or, for what has nothing to do with pictures, the true map with the
#: head's noise.
STEREO, TRUTH = "stereo", "truth"
#: Core-seconds of a run, about: on true maps, and by the size of the pictures.
_TRUTH_COST = 15.0
_PICTURE_COSTS = {0.25: 18.0, 0.5: 35.0, 1.0: 80.0}
#: Starts of a condition: of rules that may become the default, of the other rules, of the cloth's
#: material, of the sensor.
MANY_STARTS, _RULE_STARTS, _CLOTH_STARTS, _SENSOR_STARTS = 10, 5, 3, 3

_MATERIAL = load_material(Scenario().station.garment.material)


@dataclass(frozen=True)
class Condition:
    """One value of one setting.

    Attributes:
        setting: what is changed.
        value: to what, in words.
        starts: how many.
        look: STEREO or TRUTH.
        loop, sensor: of the scenario, what differs.
        material: of the cloth, what differs once the start lies.
    """

    setting: str
    value: str
    starts: int
    look: str
    loop: dict[str, Any] = field(default_factory=dict)
    sensor: dict[str, Any] = field(default_factory=dict)
    material: dict[str, float] = field(default_factory=dict)

    @property
    def is_default(self) -> bool:
        """Whether nothing differs but what looks."""
        return not (self.loop or self.sensor or self.material)

    @property
    def seconds(self) -> float:
        """Core-seconds that its runs cost, about."""
        scale = self.sensor.get("scale", Scenario().sensor.scale)
        return self.starts * (_TRUTH_COST if self.look == TRUTH else _PICTURE_COSTS[scale])

    def trials(self, seed: int, *, quick: bool = False) -> list[Trial]:
        """Its runs; the start and the loop of the k-th are those of the k-th of every other condition."""
        sensor = {"kind": self.look, **({"scale": 0.25} if quick else {}), **self.sensor}
        scenario = {
            "loop": {"actions": QUICK_ACTIONS if quick else ACTIONS, **self.loop},
            "sensor": sensor,
        }
        name = "".join(
            c if c.isalnum() else "-" for c in f"{self.look} {self.setting} {self.value}"
        )
        return [
            Trial(
                f"{name}-{k}",
                WORK,
                {
                    "scenario": scenario,
                    "seed": k,
                    "start": {"kind": "bunched", "seed": k},
                    "material": self.material,
                },
            )
            for k in range(seed, seed + (1 if quick else self.starts))
        ]


def _rule(setting: str, value: str, starts: int = _RULE_STARTS, **loop: Any) -> Condition:
    return Condition(setting, value, starts, TRUTH, loop=loop)


def _cloth(setting: str, value: str, **material: float) -> Condition:
    return Condition(setting, value, _CLOTH_STARTS, TRUTH, material=material)


def _sensor(setting: str, value: str, **sensor: float) -> Condition:
    return Condition(setting, value, _SENSOR_STARTS, STEREO, sensor=sensor)


def _bending(factor: float) -> dict[str, float]:
    return {name: factor * getattr(_MATERIAL, name) for name in ("bending", "plastic_bending")}


_ALONE: dict[str, Any] = {"pull_gain": 1.0, "pull_extra": 0.0}
_BOTH: dict[str, Any] = {"order": "together", "pull": "section"}
DEFAULT = "default"

CONDITIONS = (
    _rule(DEFAULT, "", MANY_STARTS),
    _rule("pull distance", "paper x 1.2 + 4 mm", mode="paper"),
    _rule("pull distance", "between x 1.2 + 4 mm", mode="between"),
    _rule("pull distance", "paper alone (published)", mode="paper", **_ALONE),
    _rule("pull distance", "foot alone", **_ALONE),
    _rule("pull distance", "foot x 2 + 4 mm", pull_gain=2.0),
    _rule("order", "pull", order="pull"),
    _rule("order", "height", order="height"),
    _rule("order", "length", order="length"),
    _rule("order", "together", order="together"),
    _rule("section", "through the highest part", section="highest"),
    _rule("section", "all its slack pulled", MANY_STARTS, pull="section"),
    _rule("section", "all its slack, order together", MANY_STARTS, **_BOTH),
    _cloth("friction", "0.4", friction=0.4),
    _cloth("friction", "0.5", friction=0.5),
    _cloth("friction", "0.7", friction=0.7),
    _cloth("friction", "0.8", friction=0.8),
    _cloth("stiffness", "bending x 0.5", **_bending(0.5)),
    _cloth("stiffness", "bending x 2", **_bending(2.0)),
    _cloth("stiffness", "stretch x 4", stretch=4.0 * _MATERIAL.stretch),
    Condition(DEFAULT, "", _SENSOR_STARTS, STEREO),
    _sensor("stereo noise", "x 0", noise=0.0),
    _sensor("stereo noise", "x 2", noise=2.0),
    _sensor("stereo noise", "x 4", noise=4.0),
    _sensor("image size", "0.25", scale=0.25),
    _sensor("image size", "1", scale=1.0),
)

#: What a quick run takes.
QUICK = CONDITIONS[:2]


def core_minutes(conditions: tuple[Condition, ...] = CONDITIONS) -> float:
    """What the conditions cost, about, in minutes of one core."""
    return sum(condition.seconds for condition in conditions) / 60.0
