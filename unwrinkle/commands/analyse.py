"""``unwrinkle analyse``: a capture in, its wrinkles, pictures and flattening target out."""

import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from unwrinkle.models.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from unwrinkle.perception.analysis import Analysis

_LISTED = 12


def analyse(
    capture: Annotated[Path, typer.Argument(help="Depth: .png (mm), .npy, .npz.")],
    camera: Annotated[
        str | None, typer.Option(help="A camera's name or YAML; e.g. xtion-pro-live.")
    ] = None,
    colour: Annotated[
        Path | None, typer.Option(help="Colour image; found beside UC3M and CTU captures.")
    ] = None,
    registered: Annotated[
        bool | None, typer.Option(help="Colour has the pixels of depth (default: by the file).")
    ] = None,
    pose: Annotated[
        Path | None, typer.Option(help="YAML of the camera's pose X_WC: translation, rotation.")
    ] = None,
    yaw: Annotated[
        float, typer.Option(help="Without a pose: turn of the garment about the vertical, degrees.")
    ] = 0.0,
    sensor: Annotated[
        str | None, typer.Option(help="Noise profile: stereo, xtion, tof (default: the camera's).")
    ] = None,
    mode: Annotated[str, typer.Option(help="Pull distance: foot (all slack) or paper.")] = "foot",
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the results (default: out/ and the capture's name)."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of every random choice.")] = 0,
    pictures: Annotated[bool, typer.Option(help="Draw the pictures.")] = True,
) -> None:
    """Find the wrinkles of a garment and what both hands should do about the largest."""
    from math import radians

    from rich.console import Console

    from unwrinkle.models.files import write_json
    from unwrinkle.perception.analysis import analyse as analyse_range_map
    from unwrinkle.perception.capture import load_capture, range_map_from_capture
    from unwrinkle.perception.noise import noise_profile
    from unwrinkle.perception.wrinkledness import wrinkledness

    profile = noise_profile(sensor) if sensor is not None else None
    loaded = load_capture(capture, camera, colour, colour_registered=registered, pose=pose)
    range_map = range_map_from_capture(loaded, profile=profile, yaw=radians(yaw), seed=seed)
    analysis = analyse_range_map(range_map, mode=mode, profile=profile)
    entropy = wrinkledness(analysis.surface, analysis.profile)

    folder = out or Path("out") / capture.stem
    with _finished_folder(folder) as work:
        range_map.save(work / "range_map.npz")
        report = analysis.to_json()
        report["capture"] = capture.name
        report["camera"] = loaded.camera.name
        report["wrinkledness"] = {
            "point": None if entropy.point is None else entropy.point.tolist(),
            "entropy_max": float(entropy.entropy.max()),
        }
        write_json(work / "analysis.json", report)
        if pictures:
            from unwrinkle.pictures import save_pictures

            save_pictures(work, analysis, entropy, title=capture.name)
    console = Console()
    print_analysis(console, analysis)
    console.print(f"written to {folder}/", highlight=False)


def print_analysis(console: "Console", analysis: "Analysis") -> None:
    """Print the table of wrinkles, largest first, and what is to be done."""
    from math import atan2, degrees

    from rich.table import Table

    from unwrinkle.perception.target import FlatteningTarget

    table = Table(title=f"{len(analysis.wrinkles)} wrinkles, largest first (mm, deg)")
    for name in ("", "length", "width", "chord", "peak", "pull", "angle", "score"):
        table.add_column(name, justify="right")
    for index, wrinkle in enumerate(analysis.wrinkles[:_LISTED]):
        marked = "*" if index == analysis.target_index else " "
        angle = degrees(atan2(wrinkle.direction[1], wrinkle.direction[0]))
        lengths = (
            wrinkle.length,
            wrinkle.width,
            wrinkle.chord_height,
            wrinkle.peak_height,
            wrinkle.pull_distance(analysis.mode),
        )
        table.add_row(
            f"{index + 1}{marked}",
            *(f"{1e3 * length:.1f}" for length in lengths),
            f"{angle:.0f}",
            f"{wrinkle.volume_score:.2f}",
        )
    console.print(table)
    hidden = len(analysis.wrinkles) - _LISTED
    if hidden > 0:
        console.print(f"and {hidden} smaller ones, all in analysis.json")
    target = analysis.target
    if isinstance(target, FlatteningTarget):
        for number, hand in enumerate(target.hands):
            console.print(
                f"hand {number}: grasp ({hand.p_WG[0]:+.3f}, {hand.p_WG[1]:+.3f}) m, pull "
                f"{1e3 * hand.pull_distance:.1f} mm along ({hand.pull_direction[0]:+.2f}, "
                f"{hand.pull_direction[1]:+.2f})",
                highlight=False,
            )
    else:
        console.print(f"no target: {target.reason}", highlight=False)


class _finished_folder:
    """Give a temporary folder; its files replace those in the final one when all went well."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __enter__(self) -> Path:
        try:
            self._folder.parent.mkdir(parents=True, exist_ok=True)
            if self._folder.exists() and not self._folder.is_dir():
                raise InputError(f"{self._folder}: is a file; name a folder with --out")
            self._work = Path(tempfile.mkdtemp(prefix=".unwrinkle-", dir=self._folder.parent))
        except OSError as error:
            raise InputError(f"{self._folder}: cannot be written ({error.strerror})") from None
        return self._work

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._folder.mkdir(exist_ok=True)
                for path in sorted(self._work.iterdir()):
                    path.replace(self._folder / path.name)
        finally:
            shutil.rmtree(self._work, ignore_errors=True)
