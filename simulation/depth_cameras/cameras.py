"""Simulated depth cameras of the cell: loading of models, and their images of a scene."""

from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import load_yaml, models_dir
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
#: Samples per pixel along either axis of the colour image.
_COLOUR_QUALITY = 2


def depth_camera_names() -> tuple[str, ...]:
    """Return the names of the depth cameras that the package ships."""
    return tuple(sorted(path.stem for path in (models_dir() / "depth_cameras").glob("*.yaml")))


def load_depth_camera(name: str | Path) -> DepthCameraModel:
    """Load a depth camera by its name in the package or from a YAML file.

    The only key at the file's root is the kind: `structured_light` or `time_of_flight`.

    Raises:
        InputError: unknown name, missing file, unknown kind or key, or a value out of range.
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
    """Simulate the depth image of a scene.

    Args:
        renderer: the scene; its `near` must be at most `model.near_plane` if objects may be nearer
            than its default (they would be invisible).
        model: the camera.
        X_WC: (4, 4) pose of the depth image's camera.
        seed: of the noise.

    Returns:
        Depth (h, w), metres; 0 without a reading.
    """
    return model.measured(renderer.depth(model.ideal_camera, X_WC), seed)


def depth_image(renderer: Renderer, model: DepthCameraModel, X_WC: Pose, seed: int) -> Capture:
    """Simulate a capture of a scene, with colour registered to depth.

    Args:
        renderer, model, X_WC, seed: see `depth_reading`.

    Raises:
        InputError: see `Capture`: nothing in range, or more than half of the image without a
            reading.
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
