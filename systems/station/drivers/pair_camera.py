"""Drake system of the head's real cameras.

They take one exposure of the pair per head command, once everything is at rest.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from unwrinkle.flattening.station_messages import DepthImage, HeadImage
from unwrinkle.hardware.cameras.base import PairCamera, PairPicture
from unwrinkle.models.shared import Shared
from unwrinkle.systems.abstract_state import set_state_value, state_value
from unwrinkle.systems.station.cameras import AXES_STILL, UPDATE_OFFSET
from unwrinkle.systems.station.drivers.device_clock import Clock, diagram_time
from unwrinkle.systems.station.head import HeadStatus, reported_gaze

#: Reason why there is no depth image.
NO_DEPTH = "this site has no depth camera"


@dataclass(frozen=True, eq=False)
class _Pair(Shared):
    """Last pair; `asked` is the head command that the exposure in progress answers."""

    left: HeadImage
    right: HeadImage
    asked: int = 0


class PairCameraSystem(LeafSystem):
    """Expose the head's two cameras.

    Inputs: `head` (`HeadStatus`), `position` and `velocity` (13,) of the axes. Outputs:
    `left_image`, `right_image` (`HeadImage`), `depth_image` (`DepthImage`, always without an
    image); they change only with an exposure.
    """

    def __init__(self, camera: PairCamera, *, period: float, clock: Clock = diagram_time) -> None:
        """Wrap a camera.

        Args:
            camera: driver of the pair, polled here.
            period: polling period, s.
            clock: function that gives the camera's time.
        """
        super().__init__()
        self.set_name("cameras")
        self._camera, self._clock = camera, clock
        first = HeadStatus(0, True, np.zeros(4))
        self._head = self.DeclareAbstractInputPort("head", Value(first))
        self._position = self.DeclareVectorInputPort("position", BasicVector(13))
        self._velocity = self.DeclareVectorInputPort("velocity", BasicVector(13))
        nothing = HeadImage(reason="no exposure was taken yet")
        self._pair = self.DeclareAbstractState(Value(_Pair(nothing, nothing)))
        tickets = {self.abstract_state_ticket(self._pair)}
        self.DeclareAbstractOutputPort(
            "left_image",
            lambda: Value(nothing),
            lambda context, output: output.set_value(state_value(context, self._pair).left),
            tickets,
        )
        self.DeclareAbstractOutputPort(
            "right_image",
            lambda: Value(nothing),
            lambda context, output: output.set_value(state_value(context, self._pair).right),
            tickets,
        )
        self.DeclareAbstractOutputPort(
            "depth_image",
            lambda: Value(DepthImage()),
            lambda context, output: output.set_value(
                DepthImage(state_value(context, self._pair).left.number, None, 0.0, NO_DEPTH)
            ),
            tickets,
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, UPDATE_OFFSET, self._update)

    def _update(self, context: Context, state: State) -> EventStatus:
        pair: _Pair = state_value(context, self._pair)
        head: HeadStatus = self._head.Eval(context)
        now = context.get_time()
        self._camera.poll(self._clock(now))
        if pair.asked > pair.left.number:
            picture = self._camera.result
            if picture is None or picture.number != pair.asked:
                return EventStatus.DidNothing()
            set_state_value(state, self._pair, self._taken(context, picture, head))
            return EventStatus.Succeeded()
        if head.number <= pair.left.number:
            return EventStatus.DidNothing()
        if head.reason:
            none = HeadImage(head.number, None, time=now, reason=head.reason)
            set_state_value(state, self._pair, _Pair(none, none, head.number))
            return EventStatus.Succeeded()
        if not head.still or np.abs(self._velocity.Eval(context)).max() > AXES_STILL:
            return EventStatus.DidNothing()
        self._camera.start(head.number)
        set_state_value(state, self._pair, _Pair(pair.left, pair.right, head.number))
        return EventStatus.Succeeded()

    def _taken(self, context: Context, picture: PairPicture, head: HeadStatus) -> _Pair:
        """Return the images with the reported gaze.

        There are no images if the head moved during the exposure.
        """
        now, number = context.get_time(), picture.number
        gaze = reported_gaze(head.angles, self._position.Eval(context)[0])
        reason = picture.reason
        if not head.still or head.number != number:
            reason = reason or "the head moved during the exposure"
        pixels: list[NDArray[np.uint8] | None] = [picture.left, picture.right]
        if reason:
            pixels = [None, None]
        left, right = (HeadImage(number, image, gaze, now, reason) for image in pixels)
        return _Pair(left, right, number)
