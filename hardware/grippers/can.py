"""The CloPeMa grippers of 2014 on a CAN bus: stepper motors that report their position."""

from dataclasses import dataclass
from typing import Any, Protocol

from unwrinkle.hardware.grippers.base import READ_PERIOD, SIDES, GripperPair
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import GripperSite

# Bits 9 and 10 of an identifier are the component; the lower ones the limb.
MOTOR, SENSORS = 0x200, 0x600
COMPONENTS, LIMBS = 0x600, 0x1FF

GET_POSITION, OPEN, CLOSE = 0x0D, 0x0F, 0x13
OPENING, CLOSING, CALIBRATED = 0x01, 0x20, 0x02
#: Position of closed blades; that of open ones is 0. Of one part in ten thousand.
FULL = 10000

#: ASSUMED: an open gripper stands within this of 0, and a closed one beyond CLOSED.
_OPEN_WITHIN, _CLOSED = 300, 5000
#: ASSUMED, since the frame that tells of held cloth is not public: blades with cloth between them stop at least so much
#: before their full closure.
_CLOTH = 30
#: A gripper that has not said its position for this long is not known to stand anywhere, s.
_STALE = 0.5
_MOST_FRAMES = 512


@dataclass(frozen=True)
class LimbReport:
    """What one gripper says of itself.

    Attributes:
        closure: 0 open, 1 closed.
        calibrated: whether it knows where it stands.
        moving: whether its blades move.
    """

    closure: float
    calibrated: bool
    moving: bool


class CanMessage(Protocol):
    """A frame that came, as of python-can."""

    arbitration_id: int
    data: bytearray


class CanBus(Protocol):
    """What is needed of python-can's bus."""

    def send(self, msg: Any, timeout: float | None = None) -> None:
        """Send a frame."""
        ...

    def recv(self, timeout: float | None = None) -> Any:
        """The next frame, or None."""
        ...

    def shutdown(self) -> None:
        """Close."""
        ...


def _python_can() -> Any:
    try:
        import can
    except ImportError:
        raise HardwareError(
            "grippers on a CAN bus need python-can; install it with: pip install 'unwrinkle[can]'"
        ) from None
    return can


def open_can_bus(site: GripperSite) -> CanBus:
    """Open the site's CAN bus.

    Raises:
        HardwareError: python-can is missing, or the interface cannot be opened.
    """
    can = _python_can()
    try:
        bus: CanBus = can.Bus(interface=site.interface, channel=site.channel, bitrate=site.bitrate)
    except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
        raise HardwareError(
            f"cannot open CAN interface {site.interface}, channel {site.channel}, at {site.bitrate} bit/s: "
            f"{error}; is the adapter plugged in, and its driver loaded?"
        ) from None
    return bus


class CanGrippers(GripperPair):
    """Both grippers on one bus.

    Replies are ASSUMED to carry the limb's code and the component of motor or sensors in their
    identifier, as commands do.
    """

    def __init__(self, site: GripperSite, bus: CanBus, *, stroke: float | None = None) -> None:
        """Use an open bus; nothing but questions is sent before a command.

        Args:
            site: limb codes and times.
            bus: open.
            stroke: opening of an open gripper, m; None reports no opening.
        """
        super().__init__(site)
        self._can, self._bus, self._stroke_length = _python_can(), bus, stroke
        self._next_ask = 0.0
        self._now = 0.0
        self._heard: list[tuple[int, int, float] | None] = [None, None]

    @property
    def limbs(self) -> tuple[LimbReport | None, LimbReport | None]:
        """What the right and the left gripper said lately; None for one that said nothing."""
        right, left = (self._limb(index) for index in range(2))
        return right, left

    def _limb(self, index: int) -> LimbReport | None:
        known = self._known(index)
        if known is None:
            return None
        position, bits = known
        return LimbReport(
            position / FULL, bool(bits & CALIBRATED), bool(bits & (OPENING | CLOSING))
        )

    def close(self) -> None:
        """Close the bus; the grippers stay as they are."""
        self._bus.shutdown()

    def _transmit(self, index: int, command: int) -> None:
        frame = self._can.Message(
            arbitration_id=MOTOR | self._site.limbs[index],
            data=[command],
            is_extended_id=False,
        )
        try:
            self._bus.send(frame, timeout=0.0)
        except (self._can.CanError, OSError) as error:
            raise self._broken(error) from None

    def _broken(self, error: Exception) -> HardwareError:
        return HardwareError(
            f"CAN bus {self._site.channel} fails: {error}; check its cable, its termination and the "
            "grippers' supply"
        )

    def _listen(self, now: float) -> None:
        self._now = now
        for _ in range(_MOST_FRAMES):
            try:
                frame: CanMessage | None = self._bus.recv(timeout=0.0)
            except (self._can.CanError, OSError) as error:
                raise self._broken(error) from None
            if frame is None:
                break
            self._take(frame)
        if now >= self._next_ask:
            self._next_ask = now + READ_PERIOD
            for index in range(2):
                self._transmit(index, GET_POSITION)

    def _take(self, frame: CanMessage) -> None:
        component, limb = frame.arbitration_id & COMPONENTS, frame.arbitration_id & LIMBS
        data = frame.data
        if component not in (MOTOR, SENSORS) or limb not in self._site.limbs:
            return
        if len(data) != 6 or data[0] != GET_POSITION:
            return
        position = int.from_bytes(data[1:3], "big")
        if position <= FULL:
            self._heard[self._site.limbs.index(limb)] = (position, data[5], self._now)

    def _send(self, index: int, closed: bool) -> None:
        self._heard[index] = None  # what it said before does not answer this
        self._transmit(index, CLOSE if closed else OPEN)

    def _known(self, index: int) -> tuple[int, int] | None:
        """Position and status bits; None if it has not said them lately."""
        heard = self._heard[index]
        if heard is None or self._now - heard[2] > _STALE:
            return None
        return heard[0], heard[1]

    def _lacks(self, index: int, closed: bool) -> str:
        side, known = SIDES[index], self._known(index)
        if known is None:
            return (
                f"the {side} gripper (limb {self._site.limbs[index]}) does not answer on CAN bus "
                f"{self._site.channel}; check its supply, its cable and the site's limbs"
            )
        position, bits = known
        if not bits & CALIBRATED:
            return f"the {side} gripper's position is not calibrated; calibrate it (command 0E moves it)"
        moves = bits & (OPENING | CLOSING)
        there = position >= _CLOSED if closed else position <= _OPEN_WITHIN
        if moves or not there:
            word = "closed" if closed else "open"
            return f"the {side} gripper is not {word}: it stands at {position / 100:g} % of its closure"
        return ""

    def _closed(self, index: int) -> bool:
        known = self._known(index)
        return known is not None and known[0] >= _CLOSED

    def _holding(self, index: int) -> bool | None:
        known = self._known(index)
        if known is None:
            return None
        return _CLOSED <= known[0] <= FULL - _CLOTH

    def _opening(self) -> tuple[float, float] | None:
        right, left = self._known(0), self._known(1)
        if self._stroke_length is None or right is None or left is None:
            return None
        scale = self._stroke_length / FULL
        return self._stroke_length - scale * right[0], self._stroke_length - scale * left[0]
