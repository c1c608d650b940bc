"""Learn flat area, outline and thickness of a garment from a look at it flat."""

import cv2
import numpy as np

from unwrinkle.models.errors import InputError
from unwrinkle.models.garment import KnownGarment
from unwrinkle.perception.folds.garment_outline import closed_outline
from unwrinkle.perception.folds.height_image import height_image
from unwrinkle.perception.folds.settings import fold_settings
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile

#: Greatest distance of the stored outline's corners from the seen outline, metres.
_OUTLINE_TOLERANCE_M = 0.0015

#: Greatest share of the garment without readings.
_MOST_UNSEEN = 0.05


def learn_garment(range_map: RangeMap, name: str) -> KnownGarment:
    """Learn a garment from a look at it flat.

    Args:
        range_map: of the flat garment, seen in full.
        name: for messages.

    Raises:
        InputError: the garment is not flat, or not seen in full.
    """
    settings = fold_settings(noise_profile(range_map.sensor))
    image = height_image(range_map, settings.cell)
    z = image.smoothed(settings.level_smoothing)[image.garment]
    low, high = (float(v) for v in np.percentile(z, (20.0, 99.5)))
    if high - low > settings.most_relief:
        raise InputError(
            f"garment {name!r}: stands {1e3 * (high - low):.1f} mm above its lowest cloth, at most "
            f"{1e3 * settings.most_relief:.1f} mm may be; lay it flat and look again"
        )
    if image.unseen > _MOST_UNSEEN:
        raise InputError(f"garment {name!r}: {image.unseen:.0%} of it was not seen; look again")
    outline = closed_outline(image.garment)
    points = image.world(outline)
    centre = points.mean(axis=0)
    near = cv2.approxPolyDP((points - centre).astype(np.float32), _OUTLINE_TOLERANCE_M, True)
    corners = near[:, 0].astype(float)
    return KnownGarment(
        name,
        image.surface_area(settings.smoothing),
        max(0.0, float(np.median(z))),
        corners.tolist(),
    )
