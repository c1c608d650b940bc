"""Program that exposes one pair of two DSLR cameras through libgphoto2, in a process of its own
since libgphoto2 may hang.

The parent process ends it at its deadline. The result is `result.json` in the folder of the command
line: file and time of exposure of each eye, or an error.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

RESULT = "result.json"

_USB = Path("/sys/bus/usb/devices")
#: Longest wait for one event of a camera, ms.
_EVENT_WAIT_MS = 200

#: Exposes a pair from two ports into a folder; returns per eye the file's name and the time of
#: exposure, s since 1970.
Grab = Callable[[Sequence[str], Path], list[tuple[str, float]]]


def usb_address(port: str, devices: Path = _USB) -> str:
    """Return libgphoto2's address usb:BUS,DEVICE of a USB port.

    Args:
        port: such an address, or the place of the port, as "1-1.2"; the place stays the same when
            the camera is switched off and on, the address does not.
        devices: folder in which the system lists the devices.

    Raises:
        OSError: there is no device at this port.
    """
    if port.startswith("usb:"):
        return port
    try:
        bus, device = (int((devices / port / name).read_text()) for name in ("busnum", "devnum"))
    except (OSError, ValueError):
        raise OSError(
            f"there is no device at USB port {port}; is the camera on, and in this port?"
        ) from None
    return f"usb:{bus:03d},{device:03d}"


def take_pair(ports: Sequence[str], folder: Path) -> list[tuple[str, float]]:
    """Release both cameras one after the other, then download; calls are never concurrent.

    Args:
        ports: left and right.
        folder: for the files.
    """
    import gphoto2

    known = gphoto2.PortInfoList()
    known.load()
    cameras: list[Any] = []
    try:
        for port in ports:
            camera = gphoto2.Camera()
            camera.set_port_info(known[known.lookup_path(usb_address(port))])
            camera.init()
            cameras.append(camera)
        times = []
        for camera in cameras:
            times.append(time.time())
            camera.trigger_capture()
        taken = []
        for name, camera, when in zip(("left", "right"), cameras, times, strict=True):
            taken.append((_download(gphoto2, camera, name, folder), when))
        return taken
    finally:
        for camera in cameras:
            camera.exit()


def _download(gphoto2: Any, camera: Any, name: str, folder: Path) -> str:
    """Wait for the camera's JPEG (it may write a raw file too) and save it; return its name."""
    while True:
        kind, data = camera.wait_for_event(_EVENT_WAIT_MS)
        if kind == gphoto2.GP_EVENT_FILE_ADDED and data.name.lower().endswith((".jpg", ".jpeg")):
            picture = camera.file_get(data.folder, data.name, gphoto2.GP_FILE_TYPE_NORMAL)
            picture.save(str(folder / f"{name}.jpg"))
            return f"{name}.jpg"


def main(arguments: Sequence[str], grab: Grab = take_pair) -> int:
    """Expose a pair from the ports LEFT and RIGHT into FOLDER; return 0 if it was exposed, 1 if
    not.
    """
    *ports, where = arguments
    folder = Path(where)
    try:
        taken = grab(ports, folder)
        result: dict[str, Any] = {"shots": [[file, when] for file, when in taken]}
    except ImportError:
        result = {"error": "gphoto2 is not installed; try: pip install 'unwrinkle[gphoto2]'"}
    except Exception as error:  # noqa: BLE001  libgphoto2 has its own
        result = {"error": f"{type(error).__name__}: {error}"}
    # Renamed when complete, so that the parent never reads a part.
    draft = folder / (RESULT + ".part")
    draft.write_text(json.dumps(result))
    os.replace(draft, folder / RESULT)
    return int("error" in result)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
