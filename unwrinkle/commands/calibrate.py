"""``unwrinkle calibrate``.

It computes a calibration file and its residuals from images of a calibration board.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from unwrinkle.commands._shared.examples import examples
from unwrinkle.models.errors import InputError

if TYPE_CHECKING:
    from unwrinkle.perception.calibration.boards import Board
    from unwrinkle.perception.calibration.files import Progress
    from unwrinkle.perception.camera import Camera
    from unwrinkle.perception.stereo.head_file import HeadCalibration

calibrate = typer.Typer(
    help="Calibrate cameras, the stereo head, or a camera in the gripper, "
    "from images of a calibration board.",
    no_args_is_help=True,
)

BoardOption = Annotated[
    str | None,
    typer.Option(
        "--board", metavar="COLUMNSxROWS", help="Inner corners of the calibration board, e.g. 9x6."
    ),
]
SquareOption = Annotated[float | None, typer.Option(help="Side of a square, metres.")]
CharucoOption = Annotated[
    str | None,
    typer.Option(help="ChArUco dictionary, e.g. DICT_5X5_100; a chessboard if left out."),
]
MarkerOption = Annotated[float, typer.Option(help="Side of a ChArUco marker, metres.")]


@calibrate.command(
    epilog=examples(
        "unwrinkle calibrate stereo pictures/ --board 9x6 --square 0.025",
        "unwrinkle calibrate stereo left*.png right*.png --board 11x8 --square 0.03 "
        "--charuco DICT_5X5_100 --marker 0.022",
    )
)
def stereo(
    images: Annotated[
        list[Path],
        typer.Argument(metavar="IMAGES...", help="Files left* and right*, or folders of them."),
    ],
    board: BoardOption = None,
    square: SquareOption = None,
    charuco: CharucoOption = None,
    marker: MarkerOption = 0.0,
    out: Annotated[Path, typer.Option(help="Write the calibration to this file.")] = Path(
        "stereo.yaml"
    ),
) -> None:
    """Calibrate the intrinsics of both cameras and the pose between them, from at least 8 pairs."""
    from unwrinkle.perception.calibration.files import find_board_pairs, find_pairs, save_record
    from unwrinkle.perception.calibration.stereo import calibrate_stereo
    from unwrinkle.report.calibration_pictures import save_residuals

    target = _board(board, square, charuco, marker)
    pairs = find_pairs(images)
    with _progress("finding calibration boards") as told:
        views, missing = find_board_pairs(pairs, target, told)
    fit = calibrate_stereo(views, target, not_found=missing)
    found = fit.calibration
    save_record(out, found)
    picture = out.with_suffix(".png")
    names = [record.name for record in found.views for _ in (0, 1)]
    eyes = [0, 1] * len(found.views)
    title = f"stereo calibration: {len(found.views)} pairs, RMS {found.rms:.3f} px"
    cameras = (found.left, found.right)
    save_residuals(
        picture,
        cameras,
        names=names,
        eyes=eyes,
        corners=fit.corners,
        residuals=fit.residuals,
        title=title,
    )
    for camera, sigma in zip(cameras, found.focal_sigma, strict=True):
        _print_camera(camera, f" ± {sigma:.2f}")
    baseline = sum(x * x for x in found.relative.translation) ** 0.5
    print(
        f"{len(found.views)} pairs: RMS {found.rms:.3f} px, rows {found.row_error:.3f} px apart "
        f"after rectification, baseline {baseline:.4f} m"
    )
    _print_rejected(found.rejected)
    print(f"written to {out} and {picture}")


@calibrate.command(
    "hand-eye",
    epilog=examples(
        "unwrinkle calibrate hand-eye --stereo stereo.yaml --looks looks.yaml",
        "unwrinkle calibrate hand-eye --poses poses.yaml --board 9x6 --square 0.025 "
        "--camera xtion-pro-live",
    ),
)
def hand_eye(
    stereo: Annotated[
        Path | None, typer.Option(help="Stereo calibration of the head's two cameras.")
    ] = None,
    looks: Annotated[
        Path | None, typer.Option(help="YAML file of images and pan-tilt angles (for the head).")
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option(help="YAML file of images and gripper poses (for a camera in the gripper)."),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(help="With --poses: name or YAML file of the camera; fitted if left out."),
    ] = None,
    head: Annotated[
        Path | None, typer.Option(help="Calibration to start from; the Glasgow head's if left out.")
    ] = None,
    repeatability: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="Repeatability of the pan-tilt units, rad; estimated if left out."
        ),
    ] = None,
    board: BoardOption = None,
    square: SquareOption = None,
    charuco: CharucoOption = None,
    marker: MarkerOption = 0.0,
    out: Annotated[Path | None, typer.Option(help="Write the calibration to this file.")] = None,
) -> None:
    """Calibrate the head (--stereo, --looks), or a camera in the gripper (--poses)."""
    if poses is not None:
        if stereo is not None or looks is not None:
            raise InputError("calibrate hand-eye: give --poses, or --stereo and --looks; not both")
        target = _board(board, square, charuco, marker)
        _calibrate_gripper(poses, camera, target, out or Path("gripper-camera.yaml"))
        return
    if stereo is None or looks is None:
        raise InputError("calibrate hand-eye: the head needs --stereo FILE and --looks FILE")
    from unwrinkle.perception.calibration.files import load_stereo
    from unwrinkle.perception.stereo.head_file import load_calibration, nominal_calibration

    pair = load_stereo(stereo)
    target = pair.board if board is None else _board(board, square, charuco, marker)
    nominal = load_calibration(head) if head is not None else nominal_calibration()
    from unwrinkle.perception.calibration.files import read_head_views
    from unwrinkle.perception.calibration.head import calibrate_head
    from unwrinkle.report.calibration_pictures import save_residuals

    out = out or Path("head-calibration.yaml")
    with _progress("finding calibration boards") as told:
        seen, missing = read_head_views(looks, target, told)
    fit = calibrate_head(seen, pair, nominal, joint_noise=repeatability)
    fit.calibration.save(out)
    picture = out.with_suffix(".png")
    cameras = (fit.calibration.left.camera, fit.calibration.right.camera)
    save_residuals(
        picture,
        cameras,
        names=fit.names,
        eyes=fit.eyes,
        corners=fit.corners,
        residuals=fit.adjustment.residuals,
        title=f"head calibration: RMS {fit.adjustment.rms:.3f} px",
    )
    _print_head(fit.calibration)
    for eye, (solution, sigma) in enumerate(
        zip(fit.hand_eyes, fit.adjustment.mount_sigma, strict=True)
    ):
        print(
            f"{cameras[eye].name}: camera on its mount known to {_millidegrees(sigma[3:].max())} "
            f"mdeg, {1e3 * sigma[:3].max():.3f} mm (one sigma); methods agree to "
            f"{_millidegrees(solution.turn_apart)} mdeg, {1e3 * solution.shift_apart:.2f} mm"
        )
    repeat = _millidegrees(fit.adjustment.joint_noise)
    print(f"angles of the pan-tilt units are repeatable to {repeat} mdeg (one sigma)")
    _print_rejected([*missing, *fit.rejected])
    print(f"written to {out} and {picture}")


def _calibrate_gripper(poses: Path, camera: str | None, board: "Board", out: Path) -> None:
    from unwrinkle.models.transforms import PoseRecord
    from unwrinkle.perception.calibration.files import (
        MountedCamera,
        read_gripper_views,
        save_record,
    )
    from unwrinkle.perception.calibration.gripper import calibrate_gripper_camera
    from unwrinkle.perception.camera import load_camera
    from unwrinkle.report.calibration_pictures import save_residuals

    known = load_camera(camera) if camera is not None else None
    with _progress("finding calibration boards") as told:
        X_WG, views, missing = read_gripper_views(poses, board, told)
    fit = calibrate_gripper_camera(X_WG, views, known)
    rejected = [*missing, *fit.rejected]
    mount = PoseRecord.of(fit.X_GC)
    save_record(out, MountedCamera(fit.date, fit.camera, mount, fit.rms, len(fit.views), rejected))
    picture = out.with_suffix(".png")
    names = [view.name for view in fit.views]
    corners = [view.corners for view in fit.views]
    title = f"gripper to camera: {len(names)} looks, RMS {fit.rms:.3f} px"
    eyes = [0] * len(names)
    save_residuals(
        picture,
        (fit.camera,),
        names=names,
        eyes=eyes,
        corners=corners,
        residuals=fit.residuals,
        title=title,
    )
    _print_camera(fit.camera)
    print(
        f"{len(names)} looks: RMS {fit.rms:.3f} px; methods agree to "
        f"{_millidegrees(fit.hand_eye.turn_apart)} mdeg, {1e3 * fit.hand_eye.shift_apart:.2f} mm"
    )
    _print_rejected(rejected)
    print(f"written to {out} and {picture}")


def _board(board: str | None, square: float | None, charuco: str | None, marker: float) -> "Board":
    """Return the calibration board that the options describe.

    Raises:
        InputError: its size is missing or wrong.
    """
    from unwrinkle.perception.calibration.boards import Board

    if board is None or square is None:
        raise InputError(
            "calibrate: the calibration board is not given; add e.g. --board 9x6 --square 0.025"
        )
    columns, _, rows = board.lower().partition("x")
    if not (columns.isdecimal() and rows.isdecimal()):
        raise InputError(f"--board {board!r}: give the inner corners as COLUMNSxROWS, e.g. 9x6")
    return Board(int(columns), int(rows), square, charuco or "", marker)


@contextmanager
def _progress(stage: str) -> "Iterator[Progress]":
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(stage, total=None)

        def told(done: int, total: int, name: str) -> None:
            bars.update(task, completed=done, total=total, description=f"{stage}: {name}")

        yield told


def _print_camera(camera: "Camera", focal: str = "") -> None:
    k1, k2 = (*camera.distortion, 0.0, 0.0)[:2]
    print(
        f"{camera.name}: fx {camera.fx:.2f}{focal}, fy {camera.fy:.2f}, centre ({camera.cx:.2f}, "
        f"{camera.cy:.2f}) px, k1 {k1:+.4f}, k2 {k2:+.4f}"
    )


def _print_head(calibration: "HeadCalibration") -> None:
    for eye in (calibration.left, calibration.right):
        _print_camera(eye.camera)
        print(f"{eye.camera.name}: {eye.views} views, RMS {eye.residual:.3f} px")
    print(f"rows of the looks {calibration.row_residual:.3f} px apart after rectification")


def _print_rejected(rejected: list[str]) -> None:
    for reason in rejected:
        print(f"left out {reason}")


def _millidegrees(angle: float) -> str:
    from math import degrees

    return f"{1e3 * degrees(angle):.1f}"
