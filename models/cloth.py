"""Cloth materials: one YAML file per material in `models/data/cloths`."""

import dataclasses as dc
import math
from dataclasses import dataclass
from pathlib import Path

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import load_yaml, models_dir

# Plausible ranges; a value outside is most likely in another unit.
_RANGES = {
    "areal_density": (0.02, 2.0),
    "stretch": (10.0, 1e5),
    "shear": (0.1, 1e4),
    "bending": (1e-7, 1e-1),
    "plastic_bending": (0.0, 1e-1),
    "yield_curvature": (0.1, 1e4),
    "friction": (0.0, 2.0),
    "self_friction": (0.0, 2.0),
    "thickness": (2e-4, 1e-2),
    "air_drag": (0.0, 100.0),
    "viscosity": (0.0, 0.1),
}


@dataclass(frozen=True)
class ClothMaterial:
    """The mechanics of a cloth as a thin, isotropic sheet.

    Bending is an elastic part beside an elasto-plastic one: moment per length = bending * k + m,
    where m follows plastic_bending * (k - k0) up to plastic_bending * yield_curvature and then
    slips.

    Attributes:
        name: the file's name without its ending.
        areal_density: kg/m^2.
        stretch: of warp and weft, force per width and strain, N/m.
        shear: shear force per length and angle, N/m.
        bending: elastic bending stiffness per width, N m.
        plastic_bending: stiffness of the part that creases, before it slips, N m.
        yield_curvature: at which that part slips, 1/m.
        friction: Coulomb's coefficient on table and floor.
        self_friction: of cloth on cloth.
        thickness: at rest, m.
        air_drag: rate at which still air slows the cloth, 1/s.
        viscosity: diffusion of velocity within the cloth, m^2/s.
    """

    name: str = ""
    areal_density: float = math.nan
    stretch: float = math.nan
    shear: float = math.nan
    bending: float = math.nan
    plastic_bending: float = math.nan
    yield_curvature: float = math.nan
    friction: float = math.nan
    self_friction: float = math.nan
    thickness: float = math.nan
    air_drag: float = math.nan
    viscosity: float = math.nan

    def __post_init__(self) -> None:
        """Refuse values out of range; a missing key is NaN and refused when the file is loaded."""
        for key, (least, most) in _RANGES.items():
            value = getattr(self, key)
            if not math.isnan(value) and not least <= value <= most:
                raise InputError(
                    f"cloth {self.name!r}: {key} is {value:g}, not within {least:g} to {most:g}; "
                    "check its unit"
                )

    @property
    def first_bending(self) -> float:
        """Bending stiffness before anything slips, N m."""
        return self.bending + self.plastic_bending

    def changed(self, **values: float) -> "ClothMaterial":
        """Return a material with other `values`.

        Raises:
            InputError: no cloth has such a value.
        """
        material = dc.replace(self, **values)  # type: ignore[arg-type]
        material.check()
        return material

    def check(self) -> None:
        """Refuse missing values.

        Raises:
            InputError: a value is missing or NaN.
        """
        missing = [key for key in _RANGES if math.isnan(getattr(self, key))]
        if missing:
            raise InputError(f"cloth {self.name!r}: no value for {', '.join(missing)}; give one")


def material_names() -> list[str]:
    """Return the names of the shipped materials."""
    return sorted(path.stem for path in (models_dir() / "cloths").glob("*.yaml"))


def load_material(name_or_path: str | Path) -> ClothMaterial:
    """Return the material of that name, or of the YAML file at that path.

    Raises:
        InputError: there is none, it has an unknown key, lacks one, or has an impossible value.
    """
    path = Path(name_or_path)
    if path.suffix not in {".yaml", ".yml"}:
        if str(name_or_path) not in material_names():
            raise InputError(
                f"no cloth is called {str(name_or_path)!r}; try one of "
                f"{', '.join(material_names())}, or a path to a .yaml file"
            )
        path = models_dir() / "cloths" / f"{name_or_path}.yaml"
    material = load_yaml(path, ClothMaterial)
    material = dc.replace(material, name=material.name or path.stem)
    try:
        material.check()
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return material
