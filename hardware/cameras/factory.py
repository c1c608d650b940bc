"""Opening of a site's pair of cameras."""

from unwrinkle.hardware.cameras.base import PairCamera
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import CameraSite


def open_cameras(site: CameraSite) -> PairCamera:
    """Open the cameras that a site names; nothing is exposed yet.

    Raises:
        InputError: the site names none, or lacks a setting that they need.
        HardwareError: the cameras, or their folder, do not exist.
    """
    if site.kind in ("folder", "watch"):
        from unwrinkle.hardware.cameras.folder import FolderCamera, WatchCamera

        return FolderCamera(site) if site.kind == "folder" else WatchCamera(site)
    if site.kind == "opencv":
        from unwrinkle.hardware.cameras.opencv import OpenCvCamera

        return OpenCvCamera(site)
    if site.kind == "gphoto2":
        from unwrinkle.hardware.cameras.gphoto import GphotoCamera

        return GphotoCamera(site)
    if site.kind == "openni2":
        raise InputError(
            "cameras.kind 'openni2' is one depth camera and takes no pair; give folder, watch, "
            "opencv or gphoto2"
        )
    raise InputError(
        f"cameras.kind is '{site.kind}' in the site; give folder, watch, opencv or gphoto2"
    )
