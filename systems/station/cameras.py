"""Drake system of the simulated cameras.

They take one exposure per head command, once everything in view is at rest.
"""

import dataclasses as dc
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from unwrinkle.flattening.station_messages import DepthImage, HeadImage
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.shared import Shared
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.systems.abstract_state import set_state_value, state_value
from unwrinkle.systems.station.head import HeadStatus, reported_gaze
from unwrinkle.systems.station.photographer import CellPhotographer, CellPosture

#: The axes count as at rest when all are slower than this, rad/s.
AXES_STILL = 5e-3
#: Maximum time that an exposure waits for the cloth to come to rest, s.
SETTLE_TIME = 3.0
#: Offset of the cameras' update events, s: at the instant of another system's event, an update
#: would invalidate Drake's cache of everything computed from the images.
UPDATE_OFFSET = 5e-4
#: Camera faults that can be simulated: no image, a black image, or an image of noise alone.
FAULTS = ("nothing", "black", "noise")
_FAILED = "the depth camera returned no image"


@dataclass(frozen=True, eq=False)
class Exposure(Shared):
    """Images of the last exposure, and the number of exposures so far."""

    left: HeadImage
    right: HeadImage
    depth: DepthImage
    count: int = 0


@dataclass(frozen=True)
class _Wait(Shared):
    """Wait for the cloth: number of the command, and start (s) of the rest of all else."""

    number: int = 0
    since: float = 0.0


class CameraSystem(LeafSystem):
    """Simulate the head's two cameras or the depth camera, by the scenario's sensor.

    `truth` renders nothing.

    Inputs: `head` (`HeadStatus`), `head_angles` (4,) true, `position` and `velocity` (13,) of the
    axes, `cloth` (`ClothState`). Outputs: `left_image`, `right_image` (`HeadImage`), `depth_image`
    (`DepthImage`); they change only with an exposure.
    """

    def __init__(
        self,
        cell: Cell,
        cloth: Cloth,
        state: ClothState,
        head: StereoHead,
        *,
        seed: int,
        faults: Mapping[int, str] | None = None,
    ) -> None:
        """Prepare the cameras; the scene is built at the first exposure.

        Args:
            cell: robot and cell, with the scenario's sensor and the garment's texture.
            cloth, state: solver and state of the cloth (the state gives the type of the port).
            head: true stereo head.
            seed: seed of texture, noise and faults.
            faults: fault of each failing exposure by its number, from 1.

        Raises:
            InputError: a fault is unknown.
        """
        super().__init__()
        self.set_name("cameras")
        self._faults = dict(faults or {})
        for number, kind in self._faults.items():
            if kind not in FAULTS:
                raise InputError(
                    f"cameras: fault {kind!r} of exposure {number} is unknown; known: "
                    f"{', '.join(FAULTS)}"
                )
        self._seed = seed
        self._kind = cell.scenario.sensor.kind
        self._head_camera = self._kind == "stereo"
        self._photographer = CellPhotographer(cell, cloth, head, seed)
        self._head = self.DeclareAbstractInputPort("head", Value(HeadStatus(0, True, np.zeros(4))))
        self._angles = self.DeclareVectorInputPort("head_angles", BasicVector(4))
        self._position = self.DeclareVectorInputPort("position", BasicVector(13))
        self._velocity = self.DeclareVectorInputPort("velocity", BasicVector(13))
        self._cloth = self.DeclareAbstractInputPort("cloth", Value(state))
        nothing = HeadImage(reason="no exposure was taken yet")
        first = Exposure(nothing, nothing, DepthImage(reason="no exposure was taken yet"))
        self._exposure = self.DeclareAbstractState(Value(first))
        self._wait = self.DeclareAbstractState(Value(_Wait()))
        tickets = {self.abstract_state_ticket(self._exposure)}
        for name in ("left", "right", "depth"):
            image = getattr(first, name)
            self.DeclareAbstractOutputPort(
                f"{name}_image", lambda image=image: Value(image), self._shown(name), tickets
            )
        period = cell.scenario.station.feedback_period
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, UPDATE_OFFSET, self._update)

    def _update(self, context: Context, state: State) -> EventStatus:
        last: Exposure = state_value(context, self._exposure)
        answered = (last.left if self._head_camera else last.depth).number
        head: HeadStatus = self._head.Eval(context)
        if head.number <= answered:
            return EventStatus.DidNothing()
        now = context.get_time()
        if head.reason:
            image = HeadImage(head.number, None, time=now, reason=head.reason)
            depth = DepthImage(head.number, None, now, head.reason)
            set_state_value(state, self._exposure, Exposure(image, image, depth, last.count))
            return EventStatus.Succeeded()
        if not head.still or np.abs(self._velocity.Eval(context)).max() > AXES_STILL:
            return EventStatus.DidNothing()
        cloth: ClothState = self._cloth.Eval(context)
        wait: _Wait = state_value(context, self._wait)
        if not cloth.asleep:
            if wait.number != head.number:
                set_state_value(state, self._wait, _Wait(head.number, now))
                return EventStatus.Succeeded()
            if now - wait.since < SETTLE_TIME:
                return EventStatus.DidNothing()
        set_state_value(state, self._exposure, self._exposed(context, head, cloth, last.count + 1))
        return EventStatus.Succeeded()

    def _exposed(
        self, context: Context, head: HeadStatus, cloth: ClothState, count: int
    ) -> Exposure:
        """Render the images of one exposure."""
        now = context.get_time()
        axes = self._position.Eval(context)
        gaze = reported_gaze(head.angles, axes[0])
        posture = CellPosture(axes, self._angles.Eval(context))
        seed = int(np.random.SeedSequence([self._seed, count]).generate_state(1)[0])
        fault = self._faults.get(count, "")
        number = head.number
        depth = DepthImage(number, None, now, "the depth camera is not in use")
        if not self._head_camera:
            if self._kind == "truth":
                depth = DepthImage(number, None, now, _FAILED if fault else "")
            unused = HeadImage(number, None, gaze, now, "the head's cameras are not in use")
            if self._kind == "depth":
                depth = self._depth(number, posture, cloth, seed, now, fault)
            return Exposure(unused, unused, depth, count)
        if fault == "nothing":
            none = HeadImage(number, None, gaze, now, "the camera returned no image")
            return Exposure(none, none, depth, count)
        pair: tuple[NDArray[np.uint8], ...]
        if fault:
            pair = tuple(_spoiled(fault, self._photographer.shape, seed + eye) for eye in range(2))
        else:
            pair = self._photographer.pair(posture, cloth, seed)
        left, right = (_image(number, pixels, gaze, now) for pixels in pair)
        return Exposure(left, right, depth, count)

    def _depth(
        self,
        number: int,
        posture: CellPosture,
        cloth: ClothState,
        seed: int,
        now: float,
        fault: str,
    ) -> DepthImage:
        if fault == "nothing":
            return DepthImage(number, None, now, _FAILED)
        try:
            capture = self._photographer.depth(posture, cloth, seed)
        except InputError as error:  # nothing in range: there is no image
            return DepthImage(number, None, now, str(error))
        if fault:
            rng = np.random.default_rng(seed)
            depth = np.zeros_like(capture.depth)
            if fault == "noise":
                depth = rng.uniform(0.5, 3.0, depth.shape).astype(depth.dtype)
            capture = dc.replace(capture, depth=depth)
        return DepthImage(number, capture, now)

    def _shown(self, name: str) -> Any:
        return lambda context, output: output.set_value(
            getattr(state_value(context, self._exposure), name)
        )


def _image(number: int, pixels: NDArray[np.uint8], gaze: Gaze, now: float) -> HeadImage:
    pixels.setflags(write=False)
    return HeadImage(number, pixels, gaze, now)


def _spoiled(fault: str, shape: tuple[int, int], seed: int) -> NDArray[np.uint8]:
    if fault == "black":
        return np.zeros((*shape, 3), dtype=np.uint8)
    return np.random.default_rng(seed).integers(0, 256, (*shape, 3), dtype=np.uint8)
