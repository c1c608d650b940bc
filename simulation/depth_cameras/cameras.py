"""Depth cameras of the cell: what an Xtion or a time-of-flight camera gives of a rendered scene."""

from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.loader_yaml import load_yaml, models_dir
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.simulation.depth_cameras._base import DepthCameraModel
from unwrinkle.simulation.depth_cameras.structured_light import StructuredLightCamera
from unwrinkle.simulation.depth_cameras.time_of_flight import TimeOfFlightCamera
from unwrinkle.simulation.rendering.renderer import Renderer

__all__ = [
    "DepthCameraModel",
    "StructuredLightCamera",
    "TimeOfFlightCamera",
    "depth_camera_names",
    "depth_image",
    "depth_reading",
    "load_depth_camera",
]

_KINDS: dict[str, type[DepthCameraModel]] = {
    "structured_light": StructuredLightCamera,
    "time_of_flight": TimeOfFlightCamera,
}
_COLOUR_QUALITY = 2


def depth_camera_names() -> tuple[str, ...]:
    """Return the names of the depth cameras that the package describes."""
    return tuple(sorted(path.stem for path in (models_dir() / "depth_cameras").glob("*.yaml")))


def load_depth_camera(name: str | Path) -> DepthCameraModel:
    """Return the depth camera of that name, or the one that a YAML file describes.

    The file's one key at the root says the kind: `structured_light` or `time_of_flight`.

    Raises:
        InputError: unknown name, missing file, unknown kind or key, or values no camera has.
    """
    path = Path(name)
    if str(name) in depth_camera_names():
        path = models_dir() / "depth_cameras" / f"{name}.yaml"
    elif path.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(
            f"depth camera {str(name)!r}: unknown; known are {', '.join(depth_camera_names())}, "
            "or give a .yaml"
        )
    return load_yaml(path, _KINDS[_kind(path)], child=_kind(path))


def depth_reading(
    renderer: Renderer, model: DepthCameraModel, X_WC: Pose, seed: int
) -> NDArray[np.float32]:
    """One look of a depth camera, whatever it shows.

    Args:
        renderer: the scene; made with `near` of `model.near_plane` or less where something may be
            nearer than its default (the camera would look through it).
        model: the camera.
        X_WC: (4, 4) pose of its depth image's camera.
        seed: of this look's noise.

    Returns:
        (h, w) depth, metres; 0 for no reading, all 0 where nothing is in range.
    """
    return model.measured(renderer.depth(model.ideal_camera, X_WC), seed)


def depth_image(renderer: Renderer, model: DepthCameraModel, X_WC: Pose, seed: int) -> Capture:
    """One look of a depth camera as a capture, its colour registered to depth.

    Args:
        renderer, model, X_WC, seed: as `depth_reading` takes them.

    Raises:
        InputError: what `Capture` refuses: nothing in range, or more than half of the image
            without a reading.
    """
    return Capture(
        depth=depth_reading(renderer, model, X_WC, seed),
        camera=model.camera,
        colour=renderer.colour(model.camera, X_WC, quality=_COLOUR_QUALITY),
        colour_registered=True,
        X_WC=np.asarray(X_WC, dtype=float),
        name=model.name,
    )


def _kind(path: Path) -> str:
    try:
        root = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the name or the folder") from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{path}: cannot be read as YAML ({type(error).__name__})") from None
    if not isinstance(root, dict) or len(root) != 1 or next(iter(root)) not in _KINDS:
        has = ", ".join(map(str, root)) if isinstance(root, dict) else "none"
        raise InputError(
            f"{path}: wanted one key at the root, {' or '.join(_KINDS)}; it has {has or 'none'}"
        )
    return str(next(iter(root)))
