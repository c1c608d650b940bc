"""Drake system of a real depth camera: one exposure per head command, once the axes are at rest."""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from unwrinkle.flattening.station_messages import DepthImage, HeadCommand, HeadImage
from unwrinkle.hardware.cameras.base import DepthCamera, DepthPicture
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.shared import Shared
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.simulation.depth_cameras.cameras import load_depth_camera
from unwrinkle.simulation.rendering.synthetic_towel import overhead_pose
from unwrinkle.systems.abstract_state import set_state_value, state_value
from unwrinkle.systems.station.cameras import AXES_STILL, UPDATE_OFFSET
from unwrinkle.systems.station.drivers.device_clock import Clock, diagram_time

#: Reason why there is no image of the head's cameras.
NO_HEAD = "the head's cameras are not in use"


@dataclass(frozen=True, eq=False)
class _Look(Shared):
    """Last exposure; `asked` is the head command that the exposure in progress answers."""

    image: DepthImage
    asked: int = 0


class DepthCameraDriverSystem(LeafSystem):
    """Expose the scenario's depth camera, fixed over the table; the head is not used.

    Inputs: `command` (`HeadCommand`; only its number is used), `velocity` (13,) of the axes.
    Outputs: `depth_image` (`DepthImage`); `left_image`, `right_image` (`HeadImage`, always without
    an image), which answer the same commands; `head_position` (4,), zero because the head's angles
    are unknown. Images change only with an exposure.
    """

    def __init__(
        self, cell: Cell, camera: DepthCamera, *, period: float, clock: Clock = diagram_time
    ) -> None:
        """Wrap a camera.

        Args:
            cell: robot and cell; its scenario names the camera's model, which supplies the
                intrinsics, and its place.
            camera: driver of the camera, polled here.
            period: polling period, s.
            clock: function that gives the camera's time.

        Raises:
            InputError: the depth camera is unknown.
        """
        super().__init__()
        self.set_name("cameras")
        self._camera, self._clock = camera, clock
        sensor = cell.scenario.sensor
        self._model = load_depth_camera(sensor.depth_camera)
        x, y, z = sensor.depth_camera_place
        self._X_WC = overhead_pose(x, y, z)
        self._command = self.DeclareAbstractInputPort("command", Value(HeadCommand()))
        self._velocity = self.DeclareVectorInputPort("velocity", BasicVector(13))
        nothing = "no exposure was taken yet"
        first = _Look(DepthImage(reason=nothing))
        self._look = self.DeclareAbstractState(Value(first))
        tickets = {self.abstract_state_ticket(self._look)}
        for name in ("left_image", "right_image"):
            self.DeclareAbstractOutputPort(
                name, lambda: Value(HeadImage(reason=nothing)), self._head_image, tickets
            )
        self.DeclareAbstractOutputPort(
            "depth_image",
            lambda: Value(first.image),
            lambda context, output: output.set_value(state_value(context, self._look).image),
            tickets,
        )
        self.DeclareVectorOutputPort(
            "head_position",
            BasicVector(4),
            lambda context, output: output.SetFromVector(np.zeros(4)),
            {self.nothing_ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, UPDATE_OFFSET, self._update)

    def _head_image(self, context: Context, output: Value) -> None:
        image: DepthImage = state_value(context, self._look).image
        reason = NO_HEAD if image.number else image.reason
        output.set_value(HeadImage(image.number, None, time=image.time, reason=reason))

    def _update(self, context: Context, state: State) -> EventStatus:
        look: _Look = state_value(context, self._look)
        self._camera.poll(self._clock(context.get_time()))
        resting = bool(np.abs(self._velocity.Eval(context)).max() <= AXES_STILL)
        if look.asked > look.image.number:
            picture = self._camera.result
            if picture is None or picture.number != look.asked:
                return EventStatus.DidNothing()
            image = self._taken(picture, context.get_time(), resting)
            set_state_value(state, self._look, _Look(image, look.asked))
            return EventStatus.Succeeded()
        number = self._command.Eval(context).number
        if number <= look.image.number or not resting:
            return EventStatus.DidNothing()
        self._camera.start(number)
        set_state_value(state, self._look, _Look(look.image, number))
        return EventStatus.Succeeded()

    def _taken(self, picture: DepthPicture, now: float, resting: bool) -> DepthImage:
        """Return the image as a capture; without one if the arms moved during the exposure."""
        reason = picture.reason
        if not resting:
            reason = reason or "the robot moved during the exposure"
        if reason or picture.depth is None:
            return DepthImage(picture.number, None, now, reason)
        try:
            capture = Capture(
                picture.depth,
                self._model.camera,
                picture.colour,
                colour_registered=picture.colour is not None,
                X_WC=self._X_WC,
                name=self._model.name,
            )
        except (
            InputError
        ) as error:  # the size differs from the model's, or there is too little depth
            return DepthImage(picture.number, None, now, str(error))
        return DepthImage(picture.number, capture, now)
