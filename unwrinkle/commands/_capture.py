"""Options and steps that every command on a capture shares."""

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

    from unwrinkle.models.robot import Cell
    from unwrinkle.perception.analysis import Analysis
    from unwrinkle.perception.wrinkledness import Wrinkledness

CaptureArgument = Annotated[Path, typer.Argument(help="Depth: .png (mm), .npy, .npz.")]
CameraOption = Annotated[
    str | None, typer.Option(help="A camera's name or YAML; e.g. xtion-pro-live.")
]
ColourOption = Annotated[
    Path | None, typer.Option(help="Colour image; found beside UC3M and CTU captures.")
]
RegisteredOption = Annotated[
    bool | None, typer.Option(help="Colour has the pixels of depth (default: by the file).")
]
PoseOption = Annotated[
    Path | None, typer.Option(help="YAML of the camera's pose X_WC: translation, rotation.")
]
YawOption = Annotated[
    float, typer.Option(help="Without a pose: turn of the garment about the vertical, degrees.")
]
SensorOption = Annotated[
    str | None, typer.Option(help="Noise profile: stereo, xtion, tof (default: the camera's).")
]
ModeOption = Annotated[str, typer.Option(help="Pull distance: foot (all slack) or paper.")]
OutOption = Annotated[
    Path | None, typer.Option(help="Folder for the results [out/<name of the capture>].")
]
SeedOption = Annotated[int, typer.Option(min=0, help="Of every random choice.")]
PicturesOption = Annotated[bool, typer.Option(help="Draw the pictures.")]
ScenarioOption = Annotated[
    Path | None, typer.Option(help="The cell, a *.scenario.yaml; the shipped one if left out.")
]

_LISTED = 12
#: Share of the garment beyond the table's edge that is worth a note.
_OVERHANG = 0.02


@dataclass(frozen=True)
class CaptureOptions:
    """What the user said of a capture; see the options above."""

    capture: Path
    camera: str | None = None
    colour: Path | None = None
    registered: bool | None = None
    pose: Path | None = None
    yaw: float = 0.0
    sensor: str | None = None
    mode: str = "foot"
    seed: int = 0

    @property
    def folder(self) -> Path:
        """Where results go unless the user says otherwise."""
        return Path("out") / self.capture.stem


def analysed(options: CaptureOptions, cell: "Cell") -> "Analysis":
    """Read a capture, map it and find its wrinkles.

    Args:
        options: of the capture.
        cell: for its table and the garment's place on it.

    Raises:
        InputError: a file or an option cannot be used, or there is no garment.
    """
    from math import radians

    from unwrinkle.perception.analysis import analyse
    from unwrinkle.perception.capture import load_capture, range_map_from_capture
    from unwrinkle.perception.noise import noise_profile
    from unwrinkle.perception.targeting import TableTop

    profile = noise_profile(options.sensor) if options.sensor is not None else None
    capture = load_capture(
        options.capture,
        options.camera,
        options.colour,
        colour_registered=options.registered,
        pose=options.pose,
    )
    x, y, height = cell.table_centre
    width, depth = cell.scenario.table.size
    garment_x, garment_y = cell.scenario.garment_centre
    range_map = range_map_from_capture(
        capture,
        profile=profile,
        centre=(garment_x, garment_y),
        table_height=float(height),
        yaw=radians(options.yaw),
        seed=options.seed,
    )
    table = TableTop((float(x), float(y)), (width, depth))
    return analyse(range_map, mode=options.mode, profile=profile, table=table)


def save_analysis(
    folder: Path,
    analysis: "Analysis",
    options: CaptureOptions,
    *,
    pictures: bool,
    singles: bool = False,
) -> None:
    """Write the range map, analysis.json and, if wanted, the panel of pictures and each one singly."""
    from unwrinkle.models.files import write_json

    entropy = analysis.wrinkledness
    analysis.range_map.save(folder / "range_map.npz")
    write_json(folder / "analysis.json", _report(analysis, entropy, options))
    if pictures:
        from unwrinkle.pictures import save_pictures

        save_pictures(folder, analysis, entropy, title=options.capture.name, singles=singles)


def _report(
    analysis: "Analysis", entropy: "Wrinkledness", options: CaptureOptions
) -> dict[str, object]:
    return {
        **analysis.to_json(),
        "capture": options.capture.name,
        "wrinkledness": {
            "point": None if entropy.point is None else entropy.point.tolist(),
            "entropy_max": float(entropy.entropy.max()),
        },
    }


def print_wrinkles(console: "Console", analysis: "Analysis", marked: int | None) -> None:
    """Print the table of wrinkles, largest first; the one that is to be pulled has a star."""
    from math import atan2, degrees

    from rich.table import Table

    table = Table(title=f"{len(analysis.wrinkles)} wrinkles, largest first (mm, deg)")
    for name in ("", "length", "width", "chord", "peak", "pull", "angle", "score"):
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
        )
    console.print(table)
    beyond = analysis.share_beyond_table
    if beyond > _OVERHANG:
        console.print(
            f"[bold]note[/bold]: {beyond:.0%} of the garment lies beyond the table's edge"
        )
    hidden = len(analysis.wrinkles) - _LISTED
    if hidden > 0:
        console.print(f"and {hidden} smaller ones, all in analysis.json")


@contextmanager
def finished_folder(folder: Path, *, outdated: tuple[str, ...] = ()) -> Iterator[Path]:
    """Give a temporary folder; its files replace those in the final one when all went well.

    Args:
        folder: the final one.
        outdated: files of an earlier run that would contradict the new ones, and go.

    Raises:
        InputError: the final folder cannot be made.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder}: is a file; name a folder with --out")
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
