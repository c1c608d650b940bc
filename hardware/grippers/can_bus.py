"""The CloPeMa grippers of 2014 on a CAN bus: stepper motors that report their position."""

from dataclasses import dataclass
from typing import Any, Protocol

from unwrinkle.hardware.controller.base import DigitalIo
from unwrinkle.hardware.grippers.base import READ_PERIOD_S, SIDES, GripperPair, Grippers
from unwrinkle.models.errors import ConnectionLostError, HardwareError
from unwrinkle.models.site import GripperSite

#: Components of an identifier, its bits 9 and 10.
MOTOR = 0x200
SENSORS = 0x600
#: Mask of the component, and of the limb.
COMPONENTS = 0x600
LIMBS = 0x1FF
#: Commands.
GET_POSITION = 0x0D
OPEN = 0x0F
CLOSE = 0x13
#: Status bits.
OPENING = 0x01
CALIBRATED = 0x02
CLOSING = 0x20
#: Position of closed blades, parts in ten thousand; that of open ones is 0.
CLOSED_POSITION = 10000

#: ASSUMED: largest position of an open gripper, parts in ten thousand.
_OPEN_WITHIN = 300
#: ASSUMED: least position of a closed gripper, parts in ten thousand.
_CLOSED = 5000
#: ASSUMED, since the frame that reports held cloth is not public: least distance from full closure
#: at which blades stop with cloth between them, parts in ten thousand.
_CLOTH = 30
#: Age beyond which a reported position is not used, s.
_LONGEST_AGE_S = 0.5
#: Limit of frames per poll.
_MOST_FRAMES = 512


@dataclass(frozen=True)
class LimbReport:
    """State that one gripper reports.

    Attributes:
        closure: 0 open, 1 closed.
        calibrated: whether its position is calibrated.
        moving: whether its blades move.
    """

    closure: float
    calibrated: bool
    moving: bool


class CanMessage(Protocol):
    """A received frame, as of python-can."""

    arbitration_id: int
    data: bytearray


class CanBus(Protocol):
    """The part of python-can's bus that is used."""

    def send(self, msg: Any, timeout: float | None = None) -> None:
        """Send a frame."""
        ...

    def recv(self, timeout: float | None = None) -> Any:
        """Return the next frame, or None."""
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
        raise ConnectionLostError(
            f"cannot open CAN interface {site.interface}, channel {site.channel}, at "
            f"{site.bitrate} bit/s: {error}; is the adapter plugged in, and its driver loaded?"
        ) from None
    return bus


class CanGrippers(GripperPair):
    """Both grippers on one bus.

    ASSUMED: replies carry the limb's code and the component of motor or sensors in their
    identifier, as commands do.
    """

    def __init__(self, site: GripperSite, bus: CanBus, *, stroke: float | None = None) -> None:
        """Use an open bus; only requests for positions are sent before a command.

        Args:
            site: limb codes and times.
            bus: open.
            stroke: opening of an open gripper, m; None disables the report of the opening.
        """
        super().__init__(site)
        self._can, self._bus, self._stroke_length = _python_can(), bus, stroke
        self._next_ask = 0.0
        self._now = 0.0
        self._heard: list[tuple[int, int, float] | None] = [None, None]

    @property
    def limbs(self) -> tuple[LimbReport | None, LimbReport | None]:
        """Last states of the right and left gripper; None if it has not reported lately."""
        right, left = (self._limb(index) for index in range(2))
        return right, left

    @property
    def found(self) -> str:
        """Closure of each gripper that answers."""
        return ", ".join(
            f"{side} (limb {code}) at {limb.closure:.0%} of its closure"
            for side, code, limb in zip(SIDES, self._site.limbs, self.limbs, strict=True)
            if limb is not None
        )

    @property
    def problem(self) -> str:
        """Grippers that do not answer or are not calibrated; empty if there are none."""
        wrong = []
        for side, code, limb in zip(SIDES, self._site.limbs, self.limbs, strict=True):
            if limb is None:
                wrong.append(f"the {side} gripper (limb {code}) does not answer")
            elif not limb.calibrated:
                wrong.append(
                    f"the {side} gripper is not calibrated; calibrate it (command 0E moves it)"
                )
        if None in self.limbs:
            wrong.append(
                "check the power supply, the cable, the termination and bit rate of the bus, and "
                "grippers.limbs"
            )
        bus = f"can {self._site.interface} {self._site.channel}"
        return f"{bus}: {'; '.join(wrong)}" if wrong else ""

    def _limb(self, index: int) -> LimbReport | None:
        known = self._known(index)
        if known is None:
            return None
        position, bits = known
        return LimbReport(
            position / CLOSED_POSITION, bool(bits & CALIBRATED), bool(bits & (OPENING | CLOSING))
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
        return ConnectionLostError(
            f"CAN bus {self._site.channel} fails: {error}; check its cable, its termination and "
            "the grippers' supply"
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
            self._next_ask = now + READ_PERIOD_S
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
        if position <= CLOSED_POSITION:
            self._heard[self._site.limbs.index(limb)] = (position, data[5], self._now)

    def _send(self, index: int, closed: bool) -> None:
        self._heard[index] = None  # an earlier report does not confirm this command
        self._transmit(index, CLOSE if closed else OPEN)

    def _known(self, index: int) -> tuple[int, int] | None:
        """Return position and status bits; None if they were not reported lately."""
        heard = self._heard[index]
        if heard is None or self._now - heard[2] > _LONGEST_AGE_S:
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
            return (
                f"the {side} gripper's position is not calibrated; "
                "calibrate it (command 0E moves it)"
            )
        moves = bits & (OPENING | CLOSING)
        there = position >= _CLOSED if closed else position <= _OPEN_WITHIN
        if moves or not there:
            word = "closed" if closed else "open"
            return (
                f"the {side} gripper is not {word}: it stands at {position / 100:g} % of its "
                "closure"
            )
        return ""

    def _closed(self, index: int) -> bool:
        known = self._known(index)
        return known is not None and known[0] >= _CLOSED

    def _holding(self, index: int) -> bool | None:
        known = self._known(index)
        if known is None:
            return None
        return _CLOSED <= known[0] <= CLOSED_POSITION - _CLOTH

    def _opening(self) -> tuple[float, float] | None:
        right, left = self._known(0), self._known(1)
        if self._stroke_length is None or right is None or left is None:
            return None
        scale = self._stroke_length / CLOSED_POSITION
        return self._stroke_length - scale * right[0], self._stroke_length - scale * left[0]


def open_can(site: GripperSite, io: DigitalIo | None, stroke: float | None) -> Grippers:
    """Open the site's bus; see `factory.GripperOpener`."""
    return CanGrippers(site, open_can_bus(site), stroke=stroke)
