"""Pairs of picture files: those of a folder in order, or the newest pair that another program
writes there.
"""

import threading
import time
from pathlib import Path

from unwrinkle.hardware.cameras.base import GrabbedPair, Pair, Shot, read_pictures
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.site import CameraSite

ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff")

#: Between two reads of the watched folder, s; a file that does not change between two reads is
#: complete.
READ_PERIOD_S = 0.1

#: Time of a file's last change, ns, and its size, bytes.
_State = tuple[int, int]


def _folder(site: CameraSite) -> Path:
    if not site.folder:
        raise InputError(f"cameras.kind '{site.kind}' needs cameras.folder in the site")
    folder = Path(site.folder).expanduser()
    if not folder.is_dir():
        raise HardwareError(f"cameras: there is no folder {folder}")
    return folder


def pairs_in(folder: Path, left: str = "left", right: str = "right") -> list[tuple[Path, Path]]:
    """Return pairs of picture files LEFT* and RIGHT* with the same rest of their names, sorted by
    name.

    Args:
        folder: of the files.
        left, right: begins of the names.
    """
    files = {
        path.name: path
        for path in folder.iterdir()
        if path.suffix.lower() in ENDINGS and not path.name.startswith(".")
    }
    return [
        (files[name], files[right + name[len(left) :]])
        for name in sorted(files)
        if name.startswith(left) and right + name[len(left) :] in files
    ]


class FolderCamera(GrabbedPair):
    """Returns the pairs of a folder one after the other; after the last one it fails."""

    def __init__(self, site: CameraSite) -> None:
        """List the pairs.

        Raises:
            InputError: the site names no folder.
            HardwareError: there is no such folder, or no pair in it.
        """
        folder = _folder(site)
        begins = (site.left or "left", site.right or "right")
        self._pairs = pairs_in(folder, *begins)
        if not self._pairs:
            raise HardwareError(
                f"cameras: folder {folder} has no pair of files {begins[0]}*.png and "
                f"{begins[1]}*.png"
            )
        self._next = 0
        self._folder = folder
        super().__init__(self._read, site, f"cameras (folder {folder})")

    def start(self, number: int) -> None:
        """Begin to read the next pair; a pair that cannot be read is skipped by the next start."""
        self._next += 1
        super().start(number)

    def _read(self, cancel: threading.Event) -> Pair:
        index = self._next - 1
        if index >= len(self._pairs):
            raise HardwareError(f"all {len(self._pairs)} pairs of {self._folder} have been taken")
        left, right = self._pairs[index]
        # A copied file does not state when it was exposed.
        now = time.time()
        pictures = read_pictures(left, right)
        return Shot(pictures[0], now), Shot(pictures[1], now)


class WatchCamera(GrabbedPair):
    """Returns the newest complete pair that is written into a folder after `start`.

    For cameras that another program releases and downloads. The times of exposure are those of the
    files' last change.
    """

    def __init__(self, site: CameraSite) -> None:
        """Prepare to watch; each `start` begins.

        Raises:
            InputError: the site names no folder.
            HardwareError: there is no such folder.
        """
        self._folder = _folder(site)
        self._begins = (site.left or "left", site.right or "right")
        self._before: dict[Path, _State] = {}
        super().__init__(self._watch, site, f"cameras (watching {self._folder})")

    def start(self, number: int) -> None:
        """Watch for a pair that is written from now on."""
        self._before = self._states()
        super().start(number)

    def _states(self) -> dict[Path, _State]:
        found = {}
        for pair in pairs_in(self._folder, *self._begins):
            for path in pair:
                try:
                    stat = path.stat()
                except FileNotFoundError:
                    continue
                found[path] = (stat.st_mtime_ns, stat.st_size)
        return found

    def _watch(self, cancel: threading.Event) -> Pair:
        last: dict[Path, _State] = {}
        before = self._before
        while True:
            states = self._states()
            new = [
                pair
                for pair in pairs_in(self._folder, *self._begins)
                if all(
                    path in states
                    and states[path] != before.get(path)
                    and states[path] == last.get(path)
                    and states[path][1] > 0
                    for path in pair
                )
            ]
            if new:
                left, right = max(new, key=lambda pair: max(states[path][0] for path in pair))
                pictures = read_pictures(left, right)
                return (
                    Shot(pictures[0], states[left][0] * 1e-9),
                    Shot(pictures[1], states[right][0] * 1e-9),
                )
            last = states
            if cancel.wait(READ_PERIOD_S):
                raise HardwareError(f"no new pair in {self._folder}")
