"""A pair of DSLR cameras through libgphoto2: each exposure in a child process with a deadline.

Calls to such cameras hang now and then (the Nikon D5100 is known for it), and a hanging call cannot
be ended within a process. So the child is killed at its deadline, and both USB ports are reset
before the next attempt; the reason of a failure states what is left to do by hand.
"""

import fcntl
import json
import logging
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from unwrinkle.hardware.cameras._gphoto_child import RESULT, usb_address
from unwrinkle.hardware.cameras.base import GrabbedPair, Pair, Shot, read_pictures
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.site import CameraSite

_log = logging.getLogger(__name__)

#: First part of the child's command; the two ports and a folder follow. -P: its working folder
#: hides no package.
CHILD = (sys.executable, "-P", "-m", "unwrinkle.hardware.cameras._gphoto_child")

#: Request of `ioctl` that resets a USB device.
_USBDEVFS_RESET = 0x5514
#: Between two checks of the child, s.
_CHECK_PERIOD_S = 0.02
#: Longest wait for the end of a killed child, s.
_LONGEST_KILL_S = 2.0
#: Advice for the user.
_BY_HAND = (
    "switch both cameras off and on, or take out their batteries; check that no other program "
    "holds them"
)


def reset_usb_port(port: str) -> None:
    """Reset the device at a USB port, as unplugging would.

    Raises:
        OSError: there is no device, or this user may not reset it.
    """
    bus, device = usb_address(port).removeprefix("usb:").split(",")
    handle = os.open(f"/dev/bus/usb/{bus}/{device}", os.O_WRONLY)
    try:
        fcntl.ioctl(handle, _USBDEVFS_RESET, 0)
    finally:
        os.close(handle)


class GphotoCamera(GrabbedPair):
    """Two DSLR cameras on USB."""

    def __init__(
        self,
        site: CameraSite,
        *,
        child: Sequence[str] = CHILD,
        reset: Callable[[str], None] = reset_usb_port,
    ) -> None:
        """Prepare; no process is started yet.

        Args:
            site: `left` and `right` are USB ports, as "1-1.2" or "usb:001,004".
            child: command of the process that exposes a pair; the two ports and a folder are
                appended.
            reset: resets a USB port.

        Raises:
            InputError: the site does not name two different ports.
        """
        if not site.left or not site.right or site.left == site.right:
            raise InputError(
                "cameras.kind 'gphoto2' needs two different USB ports in cameras.left and "
                f"cameras.right, got '{site.left}' and '{site.right}'"
            )
        self._ports = (site.left, site.right)
        self._child, self._reset, self._deadline = tuple(child), reset, site.timeout
        self._ill = False
        super().__init__(
            self._grab,
            site,
            f"cameras ({site.left} and {site.right})",
            margin=2.0 * _LONGEST_KILL_S,
        )

    def _grab(self, cancel: threading.Event) -> Pair:
        if self._ill:
            self._recover()
        with tempfile.TemporaryDirectory(prefix="pair-") as where:
            folder = Path(where)
            try:
                pair = self._take(folder, cancel)
            except HardwareError:
                self._ill = True
                raise
        self._ill = False
        return pair

    def _recover(self) -> None:
        for port in self._ports:
            try:
                self._reset(port)
                _log.warning("camera at %s: USB port reset", port)
            except OSError as error:
                _log.warning("camera at %s: USB port not reset: %s", port, error)

    def _take(self, folder: Path, cancel: threading.Event) -> Pair:
        complaints = folder / "stderr.txt"
        with complaints.open("wb") as errors:
            process = subprocess.Popen(
                [*self._child, *self._ports, str(folder)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
            )
        try:
            self._await(process, cancel)
        finally:
            _end(process)
        if not (folder / RESULT).is_file():
            said = complaints.read_text(errors="replace").strip().splitlines()
            raise HardwareError(
                f"the capturing process ended with code {process.returncode} and no picture"
                f"{': ' + said[-1][:200] if said else ''}; {_BY_HAND}"
            )
        return _pair(folder)

    def _await(self, process: "subprocess.Popen[bytes]", cancel: threading.Event) -> None:
        end = time.monotonic() + self._deadline
        while process.poll() is None:
            if cancel.wait(_CHECK_PERIOD_S):
                raise HardwareError("given up")
            if time.monotonic() > end:
                raise HardwareError(
                    f"the capture hung for {self._deadline:g} s, its process was killed; {_BY_HAND}"
                )


def _end(process: "subprocess.Popen[bytes]") -> None:
    if process.poll() is None:
        process.kill()
        try:
            process.wait(_LONGEST_KILL_S)
        except subprocess.TimeoutExpired:
            raise HardwareError(
                f"the capturing process {process.pid} cannot be killed: it hangs in the USB "
                "driver; unplug the cameras"
            ) from None


def _pair(folder: Path) -> Pair:
    """Read the pair that the child has exposed."""
    try:
        result = json.loads((folder / RESULT).read_text())
        if "error" in result:
            raise HardwareError(f"{result['error']}; {_BY_HAND}")
        (left, time_left), (right, time_right) = result["shots"]
        names, times = (str(left), str(right)), (float(time_left), float(time_right))
    except (ValueError, TypeError, KeyError) as error:
        raise HardwareError(f"the capturing process says nonsense: {error}") from None
    pictures = read_pictures(*(folder / Path(name).name for name in names))
    shots = [Shot(picture, when) for picture, when in zip(pictures, times, strict=True)]
    return shots[0], shots[1]
