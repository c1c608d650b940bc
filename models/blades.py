"""Geometry of the gripper's two blades near their tips, from its description."""

from dataclasses import dataclass
from xml.etree import ElementTree

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import models_dir


@dataclass(frozen=True)
class Blades:
    """Both blades in the frame T of the tool centre point (z along the blades, y from the lower to
    the upper), m.

    T lies on the outer edge of the lower blade's tip. The upper blade moves along y.

    Attributes:
        width: of either tip, along x; they are centred on x = 0.
        thickness: of either blade, along y.
        lower_end: z of the lower blade's tip.
        upper_end: z of the upper blade's tip.
    """

    width: float
    thickness: float
    lower_end: float
    upper_end: float

    def gap(self, opening: float) -> tuple[float, float]:
        """Return y of the blades' inner faces when they are `opening` apart, m."""
        return self.thickness, self.thickness + opening

    def middle(self, opening: float) -> tuple[float, float]:
        """Return y, z of the point midway between the tips, m."""
        return self.thickness + 0.5 * opening, 0.5 * (self.lower_end + self.upper_end)


def load_blades() -> Blades:
    """Read the blades from `gripper.urdf`.

    Raises:
        InputError: the description lacks the tips' boxes or the frame `tcp`, or the blades do not
            meet.
    """
    path = models_dir() / "gripper.urdf"
    root = ElementTree.parse(path).getroot()
    try:
        lower, upper = (_box(root, f"{side}_finger", f"{side}_tip") for side in ("lower", "upper"))
        tcp = _numbers(root.find("frame[@name='tcp']"), "xyz")
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: needs boxes lower_tip and upper_tip and the frame tcp"
        ) from error
    (low_size, low_at), (high_size, high_at) = lower, upper
    thickness = low_size[1]
    inner = low_at[1] + 0.5 * thickness
    if abs(high_at[1] - 0.5 * high_size[1] - inner) > 1e-6 or abs(high_size[1] - thickness) > 1e-6:
        raise InputError(f"{path}: closed blades must touch and be alike in thickness")
    return Blades(
        width=min(low_size[0], high_size[0]),
        thickness=thickness,
        lower_end=low_at[2] + 0.5 * low_size[2] - tcp[2],
        upper_end=high_at[2] + 0.5 * high_size[2] - tcp[2],
    )


def _box(root: ElementTree.Element, link: str, name: str) -> tuple[list[float], list[float]]:
    """Return size and centre, m, of a link's collision box."""
    collision = root.find(f"link[@name='{link}']/collision[@name='{name}']")
    if collision is None:
        raise KeyError(name)
    return _numbers(collision.find("geometry/box"), "size"), _numbers(
        collision.find("origin"), "xyz"
    )


def _numbers(element: ElementTree.Element | None, key: str) -> list[float]:
    if element is None:
        raise KeyError(key)
    return [float(word) for word in element.attrib[key].split()]
