"""Two virtual grippers on a CAN bus, with the protocol of the CloPeMa grippers of 2014."""

from dataclasses import dataclass
from typing import Any

from unwrinkle.models.errors import InputError

#: Faults of the grippers. silent: no replies. no_close: they accept the command and do not move.
#: lost_cloth: held cloth slips, and they close completely. uncalibrated: their position is not
#: calibrated, and they do not move.
FAULTS = ("silent", "no_close", "lost_cloth", "uncalibrated")

#: Component of the motor, and masks of component and limb, in an identifier.
_MOTOR = 0x200
_COMPONENTS = 0x600
_LIMBS = 0x1FF
#: Commands.
_ABSOLUTE_PERCENT = 0x02
_GET_POSITION = 0x0D
_OPEN = 0x0F
_CLOSE = 0x13
_STOP = 0x14
#: Status bits.
_OPENING = 0x01
_CALIBRATED = 0x02
_CLOSING = 0x20
#: Position of closed blades, parts in ten thousand.
_FULL = 10000
#: Limit of frames per poll.
_MOST_FRAMES = 512


@dataclass
class _Jaw:
    position: float = 0.0
    goal: float = 0.0


class VirtualCanGrippers:
    """Both grippers, polled on any clock.

    Attributes:
        faults: of `FAULTS`; may be changed at any time.
        cloth: whether there is cloth between the blades, right and left; may be changed at any
            time.
        commands: (limb, data) of every motor command except reads, newest last; the last 1000.
    """

    def __init__(
        self,
        bus: Any,
        *,
        limbs: tuple[int, int] = (1, 0),
        cloth: tuple[bool, bool] = (True, True),
        stroke_time: float = 0.5,
        thickness: int = 200,
        steps: int = 2000,
        faults: tuple[str, ...] = (),
    ) -> None:
        """Begin with open blades.

        Args:
            bus: of python-can, open.
            limbs: codes of the right and the left gripper.
            cloth: whether there is cloth between the blades.
            stroke_time: of a full stroke, s.
            thickness: distance from full closure at which blades stop at cloth, parts in ten
                thousand.
            steps: of the motor in a full stroke.
            faults: of `FAULTS`.

        Raises:
            InputError: an unknown fault.
        """
        for name in faults:
            if name not in FAULTS:
                raise InputError(
                    f"virtual CAN grippers: fault '{name}' is unknown; known: {', '.join(FAULTS)}"
                )
        self._bus = bus
        self._limbs = limbs
        self._speed = _FULL / stroke_time
        self._thickness, self._steps = thickness, steps
        self.faults = set(faults)
        self.cloth = cloth
        self.commands: list[tuple[int, bytes]] = []
        self._jaws = (_Jaw(), _Jaw())
        self._now: float | None = None

    @property
    def positions(self) -> tuple[float, float]:
        """Right and left: 0 open, 10000 closed."""
        return self._jaws[0].position, self._jaws[1].position

    def poll(self, now: float) -> None:
        """Advance to a time, s, and reply to received frames."""
        elapsed = 0.0 if self._now is None else max(now - self._now, 0.0)
        self._now = now
        for index, jaw in enumerate(self._jaws):
            self._move(index, jaw, elapsed)
        for _ in range(_MOST_FRAMES):
            frame = self._bus.recv(timeout=0.0)
            if frame is None:
                break
            limb = frame.arbitration_id & _LIMBS
            motor = frame.arbitration_id & _COMPONENTS == _MOTOR
            if motor and limb in self._limbs and "silent" not in self.faults:
                self._obey(self._limbs.index(limb), limb, bytes(frame.data))

    def _end(self, index: int, jaw: _Jaw) -> float:
        """Return the position that a jaw can reach towards its goal."""
        held = self.cloth[index] and "lost_cloth" not in self.faults
        return min(jaw.goal, _FULL - self._thickness) if held else jaw.goal

    def _move(self, index: int, jaw: _Jaw, elapsed: float) -> None:
        if "no_close" in self.faults and jaw.goal > jaw.position:
            return
        way = self._end(index, jaw) - jaw.position
        most = self._speed * elapsed
        jaw.position += min(max(way, -most), most)

    def _obey(self, index: int, limb: int, data: bytes) -> None:
        if not data:
            return
        jaw = self._jaws[index]
        if data[0] == _GET_POSITION:
            if len(data) == 1:
                self._report(index, limb, jaw)
            return
        self.commands = [*self.commands[-999:], (limb, data)]
        if "uncalibrated" in self.faults:
            return
        if data[0] == _OPEN:
            jaw.goal = 0.0
        elif data[0] == _CLOSE:
            jaw.goal = float(_FULL)
        elif data[0] == _STOP:
            jaw.goal = jaw.position
        elif data[0] == _ABSOLUTE_PERCENT and len(data) == 3:
            jaw.goal = float(min(int.from_bytes(data[1:], "big"), _FULL))

    def _report(self, index: int, limb: int, jaw: _Jaw) -> None:
        import can

        way = self._end(index, jaw) - jaw.position
        if "no_close" in self.faults and way > 0.0:
            way = 0.0
        bits = 0 if "uncalibrated" in self.faults else _CALIBRATED
        bits |= _CLOSING if way > 0.5 else _OPENING if way < -0.5 else 0
        position = round(jaw.position)
        steps = round(self._steps * jaw.position / _FULL)
        data = [_GET_POSITION, *position.to_bytes(2, "big"), *steps.to_bytes(2, "big"), bits]
        self._bus.send(can.Message(arbitration_id=_MOTOR | limb, data=data, is_extended_id=False))
