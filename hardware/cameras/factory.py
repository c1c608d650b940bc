"""Kinds of cameras that a site may name, and their opening."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from unwrinkle.hardware.backend import check_kind, imported
from unwrinkle.hardware.cameras.base import DepthCamera, PairCamera
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import NO_DEVICE, CameraSite


@dataclass(frozen=True)
class CameraKind:
    """Driver of one kind of cameras.

    Attributes:
        opener: function of the site, or "module:function", imported on first use. It returns a
            `DepthCamera` if `depth`, else a `PairCamera`.
        depth: whether it is one depth camera instead of the head's pair.
    """

    opener: str | Callable[[CameraSite], PairCamera | DepthCamera]
    depth: bool = False


#: Drivers by the site's `cameras.kind`; a new camera is a line here.
CAMERAS = {
    "folder": CameraKind("unwrinkle.hardware.cameras.folder:FolderCamera"),
    "watch": CameraKind("unwrinkle.hardware.cameras.folder:WatchCamera"),
    "opencv": CameraKind("unwrinkle.hardware.cameras.opencv:OpenCvCamera"),
    "gphoto2": CameraKind("unwrinkle.hardware.cameras.gphoto:GphotoCamera"),
    "openni2": CameraKind("unwrinkle.hardware.cameras.openni:OpenNi2Camera", depth=True),
}


def is_depth_camera(site: CameraSite) -> bool:
    """Return whether a site's camera is a depth camera."""
    return site.kind != NO_DEVICE and _kind(site).depth


def make_cameras(site: CameraSite) -> PairCamera:
    """Open the pair of cameras that a site names; nothing is exposed yet.

    Raises:
        InputError: the site names none, or lacks a setting that they need.
        HardwareError: the cameras, or their folder, do not exist.
    """
    camera: PairCamera = _opened(site, depth=False)
    return camera


def make_depth_camera(site: CameraSite) -> DepthCamera:
    """Open the depth camera that a site names; nothing is exposed yet.

    Raises:
        InputError: the site names none.
        HardwareError: the camera does not exist.
    """
    camera: DepthCamera = _opened(site, depth=True)
    return camera


def _opened(site: CameraSite, *, depth: bool) -> Any:
    if is_depth_camera(site) != depth or site.kind == NO_DEVICE:
        what = "a depth camera" if depth else "a pair of cameras"
        known = [name for name, kind in CAMERAS.items() if kind.depth == depth]
        raise InputError(
            f"cameras.kind '{site.kind}' of the site is not {what}; give {' or '.join(known)}"
        )
    opener = _kind(site).opener
    return (imported(opener) if isinstance(opener, str) else opener)(site)


def _kind(site: CameraSite) -> CameraKind:
    """Return the kind that a site names, registered or "module:name"."""
    check_kind("cameras.kind", site.kind, (NO_DEVICE, *CAMERAS))
    if site.kind in CAMERAS:
        return CAMERAS[site.kind]
    found = imported(site.kind)
    return found if isinstance(found, CameraKind) else CameraKind(found)
