"""From a capture to an observation.

One way for the command line, the library and the closed loop.
"""

from dataclasses import dataclass
from pathlib import Path

from unwrinkle.flattening.observation import Observation
from unwrinkle.flattening.plausibility import check_size, check_table_height, pose_hint
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.depth.range_mapping import range_map_from_capture
from unwrinkle.perception.depth.table_crop import crop_to_table
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import NoiseProfile
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import load_head_angles
from unwrinkle.perception.stereo.pair import StereoPair, load_pair
from unwrinkle.perception.wrinkles.analysis import analyse


@dataclass(frozen=True, eq=False)
class StereoCapture:
    """A pair of images with the head that took it.

    Attributes:
        pair: of images.
        head: as calibrated.
        gaze: the head's angles at the exposure.
    """

    pair: StereoPair
    head: StereoHead
    gaze: Gaze


def load_stereo_capture(
    left: str | Path, right: str | Path, head: str | Path, cell: Cell
) -> StereoCapture:
    """Read a pair of images of the stereo head.

    Args:
        left, right: image files.
        head: YAML file of the angles that the pair was taken at, which names the head's
            calibration.
        cell: with the limits of the head's axes.

    Raises:
        InputError: a file is missing or wrong.
    """
    look, calibration = load_head_angles(head)
    return StereoCapture(
        load_pair(left, right), calibration.stereo_head(cell.limits.head), look.gaze
    )


def map_of(
    capture: Capture | StereoCapture,
    cell: Cell,
    *,
    profile: NoiseProfile | None = None,
    yaw: float = 0.0,
    seed: int = 0,
) -> RangeMap:
    """Compute the range map of the garment on the cell's table.

    A depth image whose camera pose is known is cropped at the table first: from above the floor may
    fill more of the view than the table does. Without a pose the garment is laid at the scenario's
    `garment_centre`.

    Args:
        capture: depth image, or pair of images.
        cell: with the table.
        profile: of the sensor's noise; None for the capture's own.
        yaw: turn of a garment without a camera pose about the vertical, rad.
        seed: of perception's random choices.

    Raises:
        InputError: no table, no garment (`NoGarmentError`), not enough of it in view, or a garment
            or a table that cannot be where the depth and the pose put them.
    """
    if isinstance(capture, StereoCapture):
        # Imported here: its compiled kernels are slow to load.
        from unwrinkle.perception.stereo.range_mapping import range_map_from_pair

        return range_map_from_pair(
            capture.pair,
            capture.head,
            capture.gaze,
            table=cell.table,
            profile=profile,
            seed=seed,
        )
    try:
        window = capture if capture.X_WC is None else crop_to_table(capture, cell.table)
        found = range_map_from_capture(
            window,
            profile=profile,
            centre=cell.scenario.garment_centre,
            table_height=cell.table.height,
            yaw=yaw,
            seed=seed,
        )
        if capture.X_WC is not None:
            check_table_height(found, cell.table, capture.name)
        check_size(found, cell.table, capture.name)
    except InputError as error:
        hint = pose_hint(capture, cell.table)
        if hint:
            raise InputError(f"{error}; {hint}") from None
        raise
    return found


def observation_of(
    range_map: RangeMap,
    cell: Cell,
    *,
    rules: LoopSettings | None = None,
    profile: NoiseProfile | None = None,
) -> Observation:
    """Analyse a range map by the rules of the closed loop.

    Args:
        range_map: height of the garment above the table.
        cell: with the table.
        rules: reading of Eq. 5, section and pull; the scenario's `loop` if left out.
        profile: of the sensor's noise; None for the range map's own.

    Raises:
        InputError: an unknown sensor, or nothing measured on the garment.
    """
    rules = cell.scenario.loop if rules is None else rules
    analysis = analyse(
        range_map,
        mode=rules.mode,
        profile=profile,
        table=cell.table,
        section=rules.section,
        pull=rules.pull,
        opening=cell.scenario.gripper.opening,
    )
    return Observation.of(analysis, cell.garment)
