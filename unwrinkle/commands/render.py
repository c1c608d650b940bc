"""``unwrinkle render``: render a pair of the head's images, with the true heights."""

from datetime import date
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from unwrinkle.commands._shared.capture import SeedOption, finished_folder
from unwrinkle.commands._shared.settings import ScenarioOption, SetOption
from unwrinkle.models.errors import InputError

if TYPE_CHECKING:
    from unwrinkle.models.robot import Cell
    from unwrinkle.perception.range_map import RangeMap
    from unwrinkle.perception.stereo.head import Gaze, StereoHead
    from unwrinkle.simulation.rendering.synthetic_towel import Towel

_GARMENTS = ("towel", "flat")
_LEFT = "left.png"
_RIGHT = "right.png"
_LOOK = "head.yaml"
_TRUTH = "truth.npz"
#: Margin of the true range map around the garment, m.
_MARGIN = 0.05

EXAMPLES = (
    "unwrinkle render --out out/pair --scale 0.25",
    "unwrinkle render --out out/flat --garment flat --texture print --seed 3",
)


def render(
    out: Annotated[Path, typer.Option(help="Folder for the pair and its true heights.")],
    seed: SeedOption = 0,
    garment: Annotated[str, typer.Option(help="towel (three wrinkles) or flat.")] = "towel",
    texture: Annotated[
        str, typer.Option(help="Texture of the cloth: terry, print or plain.")
    ] = "terry",
    scale: Annotated[
        float, typer.Option(help="Scale of the images: 1 (16 megapixels), 0.5, 0.25 or 0.125.")
    ] = 1.0,
    gaze_at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y",
            help="Point of the table that the head looks at, m (default: the garment's).",
        ),
    ] = None,
    scenario: ScenarioOption = None,
    settings: SetOption = None,
) -> None:
    """Render the stereo head's images of a garment in the cell, with lens and noise."""
    from rich.console import Console

    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario
    from unwrinkle.perception.stereo.head_file import NOMINAL_HEAD, HeadAngles, nominal_calibration

    if garment not in _GARMENTS:
        raise InputError(f"garment {garment!r}: unknown; known are {', '.join(_GARMENTS)}")
    console = Console()
    cell = load_cell(load_scenario(scenario, settings=settings or ()))
    calibration = nominal_calibration()
    head = calibration.stereo_head(cell.limits.head)
    target = cell.table.top_centre
    target[:2] = cell.scenario.garment_centre if gaze_at is None else _point(gaze_at)
    gaze = _whole_steps(head, head.gaze_at(target))
    towel = _towel(garment, seed, cell)
    with finished_folder(out) as work:
        with console.status("rendering"):
            _write_pair(
                work, cell, head, gaze, towel=towel, texture=texture, scale=scale, seed=seed
            )
        truth_of(towel).save(work / _TRUTH)
        # A rendered pair has no date of its own; the calibration's date keeps repeated runs
        # identical.
        day = date.fromisoformat(calibration.date)
        file = f"package://unwrinkle_models/heads/{NOMINAL_HEAD}.yaml"
        HeadAngles.of(gaze, calibration, file, day).save(work / _LOOK)
    console.print(
        f"written to {out}: {_LEFT}, {_RIGHT}, {_LOOK}, {_TRUTH}; now\n"
        f"unwrinkle analyse {out / _LEFT} {out / _RIGHT} --head {out / _LOOK}",
        highlight=False,
        soft_wrap=True,
    )


def truth_of(towel: "Towel", resolution: float = 0.0005) -> "RangeMap":
    """Sample the towel's exact heights on a grid like that of a measured range map.

    Args:
        towel: towel on its table.
        resolution: cell size of the grid, m.
    """
    import numpy as np

    from unwrinkle.perception.range_map import RangeMap

    half = 0.5 * towel.side * (abs(np.cos(towel.yaw)) + abs(np.sin(towel.yaw))) + _MARGIN
    cells = np.arange(int(np.ceil(2.0 * half / resolution)) + 1)
    # Cells lie on whole multiples of the resolution, as in measured maps.
    first = [np.floor((centre - half) / resolution) * resolution for centre in towel.centre]
    x, y = np.meshgrid(first[0] + cells * resolution, first[1] + cells * resolution)
    return RangeMap(
        height=towel.height(x, y).astype(np.float32),
        valid=np.ones(x.shape, dtype=bool),
        garment=towel.edge_distance(x, y) > 0.0,
        resolution=resolution,
        origin=np.array(first),
        table_height=towel.table_height,
        sensor="stereo",
    )


def _write_pair(
    folder: Path,
    cell: "Cell",
    head: "StereoHead",
    gaze: "Gaze",
    *,
    towel: "Towel",
    texture: str,
    scale: float,
    seed: int,
) -> None:
    import cv2
    import numpy as np

    from unwrinkle.simulation.rendering.image_noise import photograph_pair, scaled_camera
    from unwrinkle.simulation.rendering.meshes import towel_mesh
    from unwrinkle.simulation.rendering.renderer import Renderer

    scaled_camera(head.left.camera, scale)  # refuses a wrong scale before the rendering
    X_WL, X_WR = head.poses(gaze)
    posture = np.zeros(len(cell.robot.axes))
    posture[0] = gaze.ext_axis
    renderer = Renderer(
        cell,
        [towel_mesh(towel, texture)],
        posture=posture,
        head=np.array([*gaze.left, *gaze.right]),
    )
    eyes = (head.left.camera, X_WL, head.right.camera, X_WR)
    for name, image in zip(
        (_LEFT, _RIGHT), photograph_pair(renderer, eyes, seed, scale=scale), strict=True
    ):
        quick = [cv2.IMWRITE_PNG_COMPRESSION, 1]  # noise does not compress
        bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        if not cv2.imwrite(str(folder / name), bgr, quick):
            raise InputError(f"{folder / name}: cannot be written; name another folder with --out")


def _towel(garment: str, seed: int, cell: "Cell") -> "Towel":
    """Place the towel at the garment's place in the cell."""
    import dataclasses as dc

    from unwrinkle.simulation.rendering.synthetic_towel import wrinkled_towel

    towel = wrinkled_towel(seed)
    x, y = cell.scenario.garment_centre
    shift = (x - towel.centre[0], y - towel.centre[1])
    ridges = tuple(
        dc.replace(ridge, centre=(ridge.centre[0] + shift[0], ridge.centre[1] + shift[1]))
        for ridge in towel.ridges
    )
    return dc.replace(
        towel,
        ridges=ridges if garment == "towel" else (),
        centre=(x, y),
        table_height=cell.table.height,
    )


def _whole_steps(head: "StereoHead", gaze: "Gaze") -> "Gaze":
    """Round the head's angles to the steps of the pan-tilt units."""
    import dataclasses as dc

    angles: dict[str, float] = {}
    for side, eye in (("left", head.left), ("right", head.right)):
        for axis in ("pan", "tilt"):
            name = f"{side}_{axis}"
            angles[name] = round(getattr(gaze, name) / eye.unit.step) * eye.unit.step
    return dc.replace(gaze, **angles)


def _point(text: str) -> tuple[float, float]:
    """Parse the two numbers of --gaze-at.

    Raises:
        InputError: they are not two finite numbers.
    """
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError:
        raise InputError(f"--gaze-at {text!r}: give X,Y in metres, e.g. 0,-1.1") from None
    if not (isfinite(x) and isfinite(y)):
        raise InputError(f"--gaze-at {text!r}: give X,Y in metres, finite, e.g. 0,-1.1")
    return x, y
