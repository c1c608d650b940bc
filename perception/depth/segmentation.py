"""Garment segmentation: GrabCut on colour with a depth prior, or depth alone.

GrabCut: C. Rother, V. Kolmogorov, A. Blake, SIGGRAPH 2004. A flat single layer of cloth is 0.5 to
3 mm high, which is below a depth camera's noise: only colour distinguishes it from the table.
"""

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from unwrinkle.models.arrays import Mask
from unwrinkle.models.errors import InsufficientViewError, NoGarmentError
from unwrinkle.perception.depth.color_registration import align_colour
from unwrinkle.perception.sensor import NoiseProfile

_log = logging.getLogger(__name__)

#: Width of the image that GrabCut works on, pixels: for the competing cuts, of which the best only
#: starts or aligns the last one, and for that.
_FIRST_WIDTH_PX = 160
_WORK_WIDTH_PX = 320

#: Threads for the competing cuts.
_WORKERS = 2

#: Least area of a garment, fraction of the view.
_MIN_AREA_FRACTION = 0.004

#: Least number of pixels of each of GrabCut's mixture models.
_MIN_SAMPLES = 20

#: Largest area of a garment, fraction of the view: the table must be visible around it.
_MAX_AREA_FRACTION = 0.92

#: Estimates of the place of a colour image with another field of view, and the change of its scale,
#: fraction, at which they agree.
_MAX_ALIGNMENTS = 6
_SAME_SCALE = 0.012

#: Least fraction of the depth core inside a colour cut; below it depth alone decides.
_MIN_CORE_FRACTION = 0.85

#: Odds of the colour ratio for the starts of the first cut; several, because the assumed
#: background may contain much of the garment.
_START_ODDS = (1.0, 2.0, 4.0)


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Segmentation of a depth image.

    Attributes:
        garment: (h, w) bool mask of the garment.
        colour: (h, w, 3) uint8 RGB in the depth image's pixels, or None.
        method: data that decided: "colour", "aligned colour" or "depth".
        raised: (h, w) bool, pixels that by depth stand above the table, the garment's and others'.
        alignment: (2, 3) affine from colour pixels to depth pixels if it was estimated.
    """

    garment: Mask
    colour: NDArray[np.uint8] | None
    method: str
    raised: Mask
    alignment: NDArray[np.float64] | None = None


def segment(
    height: NDArray[np.floating[Any]],
    seen: Mask,
    profile: NoiseProfile,
    *,
    colour: NDArray[np.uint8] | None = None,
    registered: bool = True,
    choose: Callable[[Mask], Mask] | None = None,
    seed: int = 0,
    name: str = "capture",
) -> Segmentation:
    """Segment the garment in an image of heights above the table.

    Args:
        height: (h, w) metres above the table plane; ignored where not seen.
        seen: (h, w) bool, pixels with a reading.
        profile: noise of the sensor.
        colour: (h', w', 3) uint8 RGB, or None.
        registered: whether colour and depth share pixels (h', w' = h, w). Otherwise a similarity
            between them is estimated; if that fails, depth alone decides.
        choose: returns the garment's part of the pixels (h, w) that stand above the table; None
            for all of them.
        seed: of OpenCV's random numbers (k-means start of GrabCut's mixture models).
        name: of the capture, for messages.

    Raises:
        NoGarmentError: nothing is higher than the table.
        InsufficientViewError: the garment fills nearly the whole view.
    """
    smooth = smooth_heights(height, seen, _blur_radius(height.shape, profile))
    depth_mask, core = _by_depth(smooth, seen, profile)
    raised = depth_mask & seen
    if not core.any():
        raise NoGarmentError(
            f"{name}: no garment found (nothing over {_least_area(height.size)} pixels stands "
            f"{profile.garment_height * 1e3:.1f} mm above the table); lay a garment in view"
        )
    if choose is not None:
        kept = choose(depth_mask)
        if not np.array_equal(kept, depth_mask):
            smooth = np.where(depth_mask & ~kept, np.float32(0.0), smooth)
            seen = seen & ~(depth_mask & ~kept)
            depth_mask, core = kept, core & kept
    alignment = None
    image = None
    pictured = np.ones(seen.shape, dtype=bool)  # depth pixels that the colour image covers
    method = "colour"
    if colour is not None and registered:
        image = colour
        depth_mask = _grab_cut_first(colour, core, depth_mask, seed) | core
    elif colour is not None:
        first, alignment = _aligned(colour, core, depth_mask, smooth, seen, profile, seed)
        if alignment is not None:
            size = (height.shape[1], height.shape[0])
            image = np.asarray(
                cv2.warpAffine(
                    colour, alignment, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE
                ),
                dtype=np.uint8,
            )
            warped = cv2.warpAffine(first.astype(np.uint8), alignment, size) > 0
            pictured = cv2.warpAffine(np.ones(first.shape, np.uint8), alignment, size) > 0
            # Without colour, accept only clearly raised pixels.
            clear = core & (smooth > 2.0 * profile.garment_height)
            depth_mask = np.where(pictured, warped | core, clear)
            method = "aligned colour"
    garment = depth_mask
    if image is not None:
        cut = _grab_cut(image, core, depth_mask, pictured, seed)
        if np.count_nonzero(cut & core) >= _MIN_CORE_FRACTION * np.count_nonzero(core):
            garment = cut
        else:
            image, alignment, method = (image if registered else None), None, "depth"
            garment = _by_depth(smooth, seen, profile)[0]
    else:
        method = "depth"
    if colour is not None and method == "depth":
        _log.warning(
            "%s: the colour image is not used, %s; flat parts of the garment may be missed. Give "
            "the colour camera in the camera's file, or a colour image with depth's pixels and "
            "--registered",
            name,
            "what is raised is not in its cut (is it registered?)"
            if registered
            else "its place over the depth image could not be verified",
        )
    garment = one_piece(garment)
    share = np.count_nonzero(garment) / garment.size
    if share > _MAX_AREA_FRACTION:
        raise InsufficientViewError(
            f"{name}: the garment fills {share:.0%} of the view; the table must be seen around it"
        )
    return Segmentation(garment, image, method, raised, alignment)


def _aligned(
    colour: NDArray[np.uint8],
    core: Mask,
    mask: Mask,
    smooth: NDArray[np.float32],
    seen: Mask,
    profile: NoiseProfile,
    seed: int,
) -> tuple[Mask, NDArray[np.float64] | None]:
    """Cut the garment out of an unregistered colour image, and estimate its place over depth.

    The cut begins with the core of the depth image where it would lie if both cameras had one field
    of view. If they do not, the cut is repeated with the core where the estimate has it, until
    both agree.

    Returns:
        The mask (h', w') in the colour image, and the affine (2, 3) to depth pixels; None where it
        is unknown.
    """
    first = _grab_cut_first(colour, core, mask, seed)
    scale = 1.0
    for _ in range(_MAX_ALIGNMENTS):
        found = align_colour(first, smooth, seen, span=0.8 * profile.garment_height)
        if found is None:
            break
        if not found.unusual or abs(found.scale / scale - 1.0) < _SAME_SCALE:
            return first, found.matrix
        scale = found.scale
        size = (colour.shape[1], colour.shape[0])
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        there, around = (
            np.asarray(cv2.warpAffine(part.astype(np.uint8), found.matrix, size, flags=flags)) > 0
            for part in (core, mask)
        )
        first = _grab_cut_first(colour, there, around, seed)
    return first, None


def raised_pixels(height: NDArray[np.floating[Any]], seen: Mask, profile: NoiseProfile) -> Mask:
    """Return the pixels (h, w) that by depth alone stand above the table.

    Args:
        height: (h, w) metres above the table plane.
        seen: (h, w) bool, pixels with a reading.
        profile: noise of the sensor.
    """
    smooth = smooth_heights(height, seen, _blur_radius(height.shape, profile))
    return _by_depth(smooth, seen, profile)[0] & seen


def smooth_heights(
    height: NDArray[np.floating[Any]], seen: Mask, radius: float
) -> NDArray[np.float32]:
    """Return the Gaussian mean of the readings, metres; 0 far from every reading."""
    weight = cv2.GaussianBlur(seen.astype(np.float32), (0, 0), radius)
    total = cv2.GaussianBlur(np.where(seen, height, 0.0).astype(np.float32), (0, 0), radius)
    result: NDArray[np.float32] = np.where(weight > 0.05, total / np.maximum(weight, 0.05), 0.0)
    return result.astype(np.float32)


def _blur_radius(shape: tuple[int, ...], profile: NoiseProfile) -> float:
    # Average enough for the noise to be well below the garment's least height.
    ratio = profile.depth_noise / profile.garment_height
    return float(np.clip(6.0 * ratio, 1.0, 4.0)) * max(1.0, shape[1] / 640.0)


def _least_area(size: int) -> int:
    return int(_MIN_AREA_FRACTION * size)


def _by_depth(smooth: NDArray[np.float32], seen: Mask, profile: NoiseProfile) -> tuple[Mask, Mask]:
    """Threshold heights with hysteresis; return the mask and its core above the upper threshold."""
    strong = smooth > profile.garment_height
    weak = (smooth > 0.5 * profile.garment_height).astype(np.uint8)
    weak = np.asarray(cv2.morphologyEx(weak, cv2.MORPH_OPEN, _disc(3)), dtype=np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(weak)
    strength = np.bincount(labels[strong], minlength=len(stats))
    strength[0] = 0
    least = 0.5 * _least_area(smooth.size)
    # Thick cloth with one high fold is mostly weak; a garment's area of strong pixels is no noise.
    enough = (strength > 0.25 * stats[:, cv2.CC_STAT_AREA]) | (strength > _least_area(smooth.size))
    good = enough & (stats[:, cv2.CC_STAT_AREA] > least)
    good &= strength > 0.05 * max(1, strength.max())
    good[0] = False
    mask: Mask = good[labels]
    if np.count_nonzero(mask) < _least_area(smooth.size):
        mask = np.zeros_like(mask)
    return mask, mask & strong & seen


def _disc(radius: int) -> NDArray[np.uint8]:
    size = 2 * radius + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), dtype=np.uint8)


def _resize(mask: Mask, size: tuple[int, int]) -> Mask:
    resized = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return np.asarray(resized) > 0


def _small(image: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    scale = min(1.0, width / image.shape[1])
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _run_grab_cut(image: NDArray[np.uint8], labels: NDArray[np.uint8], seed: int) -> Mask:
    start: Mask = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    if min(np.count_nonzero(start), np.count_nonzero(~start)) < _MIN_SAMPLES:
        return start  # too few samples for one of the mixture models
    cv2.setRNGSeed(seed)
    lab = cv2.cvtColor(image, cv2.COLOR_RGB2LAB)
    background, foreground = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(lab, labels, (0, 0, 0, 0), background, foreground, 4, cv2.GC_INIT_WITH_MASK)
    return (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)


def _grab_cut_first(colour: NDArray[np.uint8], core: Mask, mask: Mask, seed: int) -> Mask:
    """Segment a colour image that is roughly aligned with the depth image.

    Depth may show only a part of thin cloth; the rest would then train the background model.
    Therefore GrabCut runs from several starts (the depth mask, and masks of pixels whose colour is
    more likely in the core than in the surroundings). The cut is kept whose edge strength along its
    outline, times its overlap with the other cuts, is greatest, and is refined.
    """
    small = _small(colour, _FIRST_WIDTH_PX)
    size = (small.shape[1], small.shape[0])
    inside = cv2.erode(_resize(core, size).astype(np.uint8), _disc(4)) > 0
    if np.count_nonzero(inside) < 50:
        inside = cv2.erode(_resize(core, size).astype(np.uint8), _disc(2)) > 0
    outside = cv2.dilate(_resize(mask, size).astype(np.uint8), _disc(5)) == 0
    lab = cv2.cvtColor(small, cv2.COLOR_RGB2LAB)
    ratio = _density(lab, inside) / (_density(lab, outside) + 1e-9)
    sure = cv2.erode(inside.astype(np.uint8), _disc(2)) > 0

    def cut(start: Mask) -> tuple[float, Mask]:
        labels = np.where(start, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
        labels[sure] = cv2.GC_FGD
        mask = one_piece(_run_grab_cut(small, labels, seed))
        return _edge_strength(lab, mask), mask

    starts = [_resize(mask, size), *(odds * ratio > 1.0 for odds in _START_ODDS)]
    with ThreadPoolExecutor(_WORKERS) as pool:  # OpenCV's random state is per thread
        cuts = [(strength, mask) for strength, mask in pool.map(cut, starts) if strength > 0.0]
    if not cuts:
        return np.zeros(colour.shape[:2], dtype=bool)
    # A dark fold alone has stronger edges than the cloth around it, but few starts end there.
    _, best = max(
        cuts, key=lambda scored: scored[0] * sum(_overlap(scored[1], other) for _, other in cuts)
    )
    fine = _small(colour, _WORK_WIDTH_PX)
    size = (fine.shape[1], fine.shape[0])
    labels = np.where(_resize(best, size), cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[_resize(sure, size)] = cv2.GC_FGD
    refined = one_piece(_run_grab_cut(fine, labels, seed))
    return _resize(refined, (colour.shape[1], colour.shape[0]))


def _edge_strength(lab: NDArray[Any], mask: Mask) -> float:
    """Return the mean colour gradient on the outline times the fraction of free image border."""
    blurred = cv2.GaussianBlur(lab, (0, 0), 1.5).astype(np.float32)
    right, down = (np.asarray(cv2.Sobel(blurred, cv2.CV_32F, i, 1 - i)) for i in (1, 0))
    gradient = np.sqrt((right**2 + down**2).sum(axis=-1))
    near = cv2.dilate(np.minimum(gradient, np.percentile(gradient, 95.0)), _disc(2))
    outline = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_GRADIENT, _disc(1)) > 0
    outline[[0, 1, -2, -1], :] = False
    outline[:, [0, 1, -2, -1]] = False
    if not outline.any():
        return -1.0
    frame = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]]).mean()
    return float(np.asarray(near)[outline].mean() * (1.0 - frame))


def _overlap(first: Mask, second: Mask) -> float:
    """Return intersection over union of two masks that are not empty."""
    return float(np.count_nonzero(first & second) / np.count_nonzero(first | second))


def _density(lab: NDArray[Any], where: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return each pixel's colour density among the pixels `where` (smoothed histogram)."""
    bins = (lab >> 4).astype(np.intp)
    index = (bins[..., 0] * 16 + bins[..., 1]) * 16 + bins[..., 2]
    counts = np.bincount(index[where], minlength=4096).reshape(16, 16, 16)
    number = max(1.0, float(where.sum()))
    smooth = np.asarray(gaussian_filter(counts.astype(np.float32), 1.2)) / np.float32(number)
    density: NDArray[np.float32] = smooth.ravel()[index]
    return density


def _grab_cut(image: NDArray[np.uint8], core: Mask, mask: Mask, pictured: Mask, seed: int) -> Mask:
    """Segment a registered colour image; fixed labels far outside the prior and in its core."""
    small = _small(image, _WORK_WIDTH_PX)
    size = (small.shape[1], small.shape[0])
    prior = _resize(mask, size)
    labels = np.full(small.shape[:2], cv2.GC_BGD, dtype=np.uint8)
    labels[cv2.dilate(prior.astype(np.uint8), _disc(12)) > 0] = cv2.GC_PR_BGD
    labels[prior] = cv2.GC_PR_FGD
    labels[cv2.erode(_resize(core, size).astype(np.uint8), _disc(4)) > 0] = cv2.GC_FGD
    known = _resize(pictured, size)
    labels[~known] = np.where(prior[~known], cv2.GC_FGD, cv2.GC_BGD)
    cut = _run_grab_cut(small, labels, seed).astype(np.float32)
    full = cv2.resize(cut, (image.shape[1], image.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(full) > 0.5


def one_piece(mask: Mask, radius: int | None = None) -> Mask:
    """Return the largest component after closing and opening with a disc, its holes filled."""
    if radius is None:
        radius = max(2, round(mask.shape[1] / 320))
    margin = 3 * radius + 2
    padded = np.pad(mask.astype(np.uint8), margin, mode="edge")
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, _disc(radius))
    closed = cv2.morphologyEx(closed, cv2.MORPH_OPEN, _disc(radius))
    closed = closed[margin:-margin, margin:-margin]
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed)
    if count < 2:
        return np.zeros_like(mask)
    piece = (labels == 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA])).astype(np.uint8)
    contours, _ = cv2.findContours(piece, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(np.zeros_like(piece), contours, -1, 1, cv2.FILLED)) > 0
