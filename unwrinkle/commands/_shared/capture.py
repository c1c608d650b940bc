"""Options and steps shared by the commands that read a capture."""

import logging
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from unwrinkle.models.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from unwrinkle.flattening.flattener import Choice, Flattener, NoChoice
    from unwrinkle.flattening.observation import Observation
    from unwrinkle.models.robot import Cell

CaptureArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="DEPTH | LEFT RIGHT",
        help="Depth: .png (mm), .npy, .npz; or the left and the right image of a pair.",
    ),
]
HeadOption = Annotated[
    Path | None, typer.Option(help="For a pair: head.yaml with the head's angles.")
]
CameraOption = Annotated[
    str | None, typer.Option(help="Name or YAML file of a camera; e.g. xtion-pro-live.")
]
ColourOption = Annotated[
    Path | None, typer.Option(help="Colour image; found beside UC3M and CTU captures.")
]
RegisteredOption = Annotated[
    bool | None, typer.Option(help="Whether colour has the pixels of depth (default: by the file).")
]
PoseOption = Annotated[
    Path | None,
    typer.Option(help="File of the camera's pose in the world: translation, rotation; or of ROS."),
]
DepthUnitOption = Annotated[
    float | None,
    typer.Option(
        help="Metres per unit of the depth file (default: by the file, or 0.001 of integers)."
    ),
]
AtOption = Annotated[
    str | None,
    typer.Option(
        metavar="COLUMN,ROW", help="A pixel on the garment, where several things lie in view."
    ),
]
RegionOption = Annotated[
    str | None,
    typer.Option(
        metavar="LEFT,TOP,RIGHT,BOTTOM", help="Use only this part of the depth image, pixels."
    ),
]
YawOption = Annotated[
    float, typer.Option(help="Without a pose: rotation of the garment about the vertical, degrees.")
]
SensorOption = Annotated[
    str | None,
    typer.Option(help="Noise profile: stereo, stereo-head, xtion, tof (default: the camera's)."),
]
ModeOption = Annotated[
    str | None,
    typer.Option(
        help="Pull distance: foot (all slack), paper or between (default: the scenario's)."
    ),
]
OutOption = Annotated[
    Path | None, typer.Option(help="Folder for the results (default: out/<name of the capture>).")
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")]
PicturesOption = Annotated[bool, typer.Option(help="Draw the pictures.")]

_log = logging.getLogger(__name__)

#: Maximum number of wrinkles in the printed table.
_LISTED = 12
#: Share of the garment beyond the table's edge above which a note is printed.
_OVERHANG = 0.02


@dataclass(frozen=True)
class CaptureOptions:
    """Options of a capture; see the option types above."""

    files: tuple[Path, ...]
    head: Path | None = None
    camera: str | None = None
    colour: Path | None = None
    registered: bool | None = None
    pose: Path | None = None
    depth_unit: float | None = None
    at: str | None = None
    region: str | None = None
    yaw: float = 0.0
    sensor: str | None = None
    mode: str | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse options that contradict each other.

        Raises:
            InputError: with the names of the options.
        """
        count = len(self.files)
        if count > 2:
            raise InputError(
                f"{count} files were given; give one depth file or the two images of a pair"
            )
        if count == 2 and self.head is None:
            hint = "add --head head.yaml"
            if not self.files[1].suffix:
                hint += f", or leave out {str(self.files[1])!r} if it is no image"
            raise InputError(f"two images were given without the head's angles; {hint}")
        if count == 1 and self.head is not None:
            raise InputError("--head is for the two images LEFT and RIGHT; one file was given")
        of_depth = ("camera", "colour", "registered", "pose", "depth_unit", "at", "region")
        wrong = [name for name in of_depth if getattr(self, name) is not None]
        if self.yaw:
            wrong.append("yaw")
        if count == 2 and wrong:
            options = ", ".join(f"--{name.replace('_', '-')}" for name in wrong)
            raise InputError(
                f"{options}: not allowed with two images; head.yaml contains this data"
            )

    @property
    def name(self) -> str:
        """Return the capture's name for titles and files."""
        return " + ".join(path.name for path in self.files)

    @property
    def folder(self) -> Path:
        """Return the default folder of the results."""
        return Path("out") / self.files[0].stem


def flattener_for(options: CaptureOptions, cell: "Cell") -> "Flattener":
    """Return the flattener of a cell with the user's sensor and reading of Eq. 5.

    Raises:
        InputError: the sensor or mode is unknown.
    """
    import dataclasses as dc

    from unwrinkle.flattening.flattener import Flattener
    from unwrinkle.perception.sensor import noise_profile

    rules = cell.scenario.loop
    if options.mode is not None:
        rules = dc.replace(rules, mode=options.mode)
    profile = noise_profile(options.sensor) if options.sensor is not None else None
    return Flattener(cell, rules=rules, profile=profile)


def observed(options: CaptureOptions, flattener: "Flattener") -> "Observation":
    """Read a capture and find its wrinkles.

    Raises:
        InputError: a file or an option cannot be used, or there is no garment.
    """
    import dataclasses as dc
    from math import radians

    from unwrinkle.flattening.capture_to_observation import StereoCapture, load_stereo_capture
    from unwrinkle.perception.depth.capture import Capture, load_capture
    from unwrinkle.perception.depth.table_crop import crop_to_region

    capture: Capture | StereoCapture
    if options.head is not None:
        left, right = options.files
        capture = load_stereo_capture(left, right, options.head, flattener.cell)
    else:
        capture = load_capture(
            options.files[0],
            options.camera,
            options.colour,
            colour_registered=options.registered,
            pose=options.pose,
            depth_unit=options.depth_unit,
        )
        if options.at is not None:
            column, row = _pixels(options.at, 2, "--at", "COLUMN,ROW")
            capture = dc.replace(capture, garment_at=(column, row))
        if options.region is not None:
            wanted = "LEFT,TOP,RIGHT,BOTTOM"
            capture = crop_to_region(capture, _pixels(options.region, 4, "--region", wanted))
        if capture.X_WC is None:
            _log.warning(
                "%s: no pose of the camera; the garment is taken to lie at the scenario's "
                "garment_centre. Such a plan is for a look, not for a garment in the cell",
                options.files[0],
            )
    return flattener.observe(capture, yaw=radians(options.yaw), seed=options.seed)


def _pixels(text: str, count: int, option: str, wanted: str) -> list[int]:
    """Return the whole numbers of an option.

    Raises:
        InputError: they are not as many as wanted, or no numbers.
    """
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise InputError(f"{option} {text}: give {wanted} in pixels, e.g. without spaces")
    return numbers


def save_analysis(
    folder: Path,
    observation: "Observation",
    chosen: "Choice | NoChoice",
    options: CaptureOptions,
    *,
    pictures: bool,
    singles: bool = False,
) -> None:
    """Write the range map, analysis.json and optionally the pictures."""
    from unwrinkle.models.io.files import write_json

    analysis = observation.analysis
    analysis.range_map.save(folder / "range_map.npz")
    write_json(folder / "analysis.json", _report(observation, chosen, options))
    if pictures:
        from unwrinkle.runs.pictures import save_pictures

        save_pictures(
            folder,
            analysis,
            chosen,
            folds=observation.folds,
            title=options.name,
            singles=singles,
        )


def _report(
    observation: "Observation", chosen: "Choice | NoChoice", options: CaptureOptions
) -> dict[str, object]:
    from unwrinkle.flattening.flattener import Choice, analysis_report

    entropy = observation.analysis.wrinkledness
    if isinstance(chosen, Choice):
        index = chosen.decision.wrinkle.index
        report = analysis_report(observation, target=chosen.target, wrinkle=index)
    else:
        report = analysis_report(observation, stop=chosen.stop)
    return {
        **report,
        "capture": options.name,
        "wrinkledness": {
            "point": None if entropy.point is None else entropy.point.tolist(),
            "entropy_max": float(entropy.entropy.max()),
        },
    }


def print_garment(
    console: "Console", observation: "Observation", chosen: "Choice | NoChoice | None"
) -> None:
    """Print the table of wrinkles, largest first, the garment's state and its flaps.

    A star marks the wrinkle to be pulled.
    """
    from unwrinkle.flattening.flattener import Choice

    analysis = observation.analysis
    if analysis.wrinkles:
        marked = chosen.decision.wrinkle.index if isinstance(chosen, Choice) else None
        console.print(_wrinkle_table(observation, marked))
    else:
        console.print("no wrinkles")
    beyond = analysis.share_beyond_table
    if beyond > _OVERHANG:
        console.print(
            f"[bold]note[/bold]: {beyond:.0%} of the garment lies beyond the table's edge"
        )
    hidden = len(analysis.wrinkles) - _LISTED
    if hidden > 0:
        console.print(f"and {hidden} smaller wrinkles, listed in analysis.json")

    folds = observation.folds
    console.print(f"garment: {folds.state} ({'; '.join(folds.reasons)})", highlight=False)
    for flap in folds.flaps:
        console.print(
            f"flap of {1e4 * flap.area:.0f} cm2 ({flap.by}): fold line from "
            f"({flap.line[0, 0]:+.3f}, {flap.line[0, 1]:+.3f}) to ({flap.line[1, 0]:+.3f}, "
            f"{flap.line[1, 1]:+.3f}) m, opens along ({flap.opening[0]:+.2f}, "
            f"{flap.opening[1]:+.2f})",
            highlight=False,
        )


def _wrinkle_table(observation: "Observation", marked: int | None) -> "Table":
    from math import atan2, degrees

    from rich.table import Table

    analysis, kinds = observation.analysis, observation.folds.kinds
    count = len(analysis.wrinkles)
    title = f"{count} wrinkle{'s' * (count > 1)}, largest first (mm, deg)"
    star = "" if marked is None else "; * to be pulled"
    table = Table(title=title, caption=f"score: logarithm of the volume{star}")
    for name in ("", "length", "width", "chord", "peak", "pull", "angle", "score", "what"):
        table.add_column(name, justify="right")
    for index, wrinkle in enumerate(analysis.wrinkles[:_LISTED]):
        lengths = (
            wrinkle.length,
            wrinkle.width,
            wrinkle.chord_height,
            wrinkle.peak_height,
            wrinkle.pull_distance(analysis.mode),
        )
        angle = degrees(atan2(wrinkle.direction[1], wrinkle.direction[0]))
        table.add_row(
            f"{index + 1}{'*' if index == marked else ' '}",
            *(f"{1e3 * length:.1f}" for length in lengths),
            f"{angle:.0f}",
            f"{wrinkle.volume_score:.2f}",
            kinds[index].value,
        )
    return table


def check_folder(folder: Path) -> None:
    """Refuse a file in the place of a folder for results, before any work.

    Raises:
        InputError: naming it.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; give the name of a folder with --out")


@contextmanager
def finished_folder(folder: Path, *, outdated: tuple[str, ...] = ()) -> Iterator[Path]:
    """Yield a temporary folder; on success its files replace those of the final folder.

    Args:
        folder: final folder.
        outdated: files of an earlier run to delete, since they would contradict the new ones.

    Raises:
        InputError: the final folder cannot be made.
    """
    check_folder(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=".unwrinkle-", dir=folder.parent))
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
    try:
        yield work
        folder.mkdir(exist_ok=True)
        for path in sorted(work.iterdir()):
            path.replace(folder / path.name)
        for name in outdated:
            (folder / name).unlink(missing_ok=True)
    finally:
        shutil.rmtree(work, ignore_errors=True)
