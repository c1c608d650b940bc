"""Least-squares tensor-product B-spline of a height map.

Two variants solve the same separable problem, min || W (By C Bx^T - Z) ||, and differ in their
knots only. Open uniform knots give one smooth surface (the default). Knots of full multiplicity at
the patch borders give the source paper's independent patches of 5 x 5 control points (degree 3,
knots 0 0 0 0 1 2 2 2 2). Ridges and contours come from second derivatives, which are discontinuous
at the borders of the patches.

The single surface has degree 5. The second derivative of a cubic spline is linear between knots;
with a knot spacing near a ridge's sigma, its zeros (the contours) are off by up to 0.5 mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded

from unwrinkle.models.errors import InputError

#: Degree of the single surface: C4, so that the second derivative is smooth.
DEGREE = 5

#: Order of the derivative that the smoothing penalises.
PENALTY_ORDER = 3

#: Degree of the source paper's patches.
PATCH_DEGREE = 3

#: Side of one of the source paper's patches, in knot spacings.
PATCH_SPANS = 2

Floats = NDArray[np.float32]


def open_uniform_knots(length: float, spacing: float) -> NDArray[np.float64]:
    """Return open uniform knots of DEGREE on [0, length], metres, spaced by about `spacing`."""
    spans = max(1, round(length / spacing))
    inner = np.linspace(0.0, length, spans + 1)
    return np.concatenate([[0.0] * DEGREE, inner, [length] * DEGREE])


def patch_knots(length: float, spacing: float) -> NDArray[np.float64]:
    """Return the knots of the source paper's independent patches on [0, length], metres.

    Each patch is 2 * spacing long, with knots 0 0 0 0 1 2 2 2 2 (five control points). Knots of
    multiplicity PATCH_DEGREE + 1 at the borders decouple neighbouring patches.
    """
    patches = max(1, round(length / (PATCH_SPANS * spacing)))
    borders = np.linspace(0.0, length, patches + 1)
    middles = 0.5 * (borders[1:] + borders[:-1])
    knots = [np.repeat(borders[0], PATCH_DEGREE + 1)]
    for middle, border in zip(middles, borders[1:], strict=True):
        knots += [np.array([middle]), np.repeat(border, PATCH_DEGREE + 1)]
    return np.concatenate(knots)


def design_matrix(
    knots: NDArray[np.float64], points: NDArray[np.float64], degree: int, order: int = 0
) -> Floats:
    """Return the (n, controls) float32 matrix of the basis functions' `order`-th derivatives."""
    basis = BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    return np.ascontiguousarray(basis(points, nu=order), dtype=np.float32)


@dataclass(frozen=True, eq=False)
class TensorSpline:
    """Tensor-product B-spline z(x, y) on [0, length_x] x [0, length_y], metres.

    Attributes:
        knots_x, knots_y: knot vectors, metres.
        control: (ny, nx) control heights, metres, float32.
        degree: DEGREE or PATCH_DEGREE.
    """

    knots_x: NDArray[np.float64]
    knots_y: NDArray[np.float64]
    control: Floats
    degree: int

    def sample(
        self, x: NDArray[np.float64], y: NDArray[np.float64], orders: list[tuple[int, int]]
    ) -> list[Floats]:
        """Evaluate derivatives of the surface on the grid of x (columns) and y (rows).

        Args:
            x: (nx,) metres within the spline's domain.
            y: (ny,) metres within the spline's domain.
            orders: list of (order along x, order along y), each order 0, 1 or 2.

        Returns:
            One (ny, nx) float32 array per entry of `orders`; units m, 1, 1/m.
        """
        along_x = {
            i: design_matrix(self.knots_x, x, self.degree, i).T for i in {i for i, _ in orders}
        }
        rows = {
            j: design_matrix(self.knots_y, y, self.degree, j) @ self.control
            for j in {j for _, j in orders}
        }
        return [_single(rows[j] @ along_x[i]) for i, j in orders]


class _Axis:
    """Design matrix, normal matrix and banded Cholesky factor of one axis."""

    def __init__(
        self,
        knots: NDArray[np.float64],
        points: NDArray[np.float64],
        degree: int,
        smoothing: float,
    ) -> None:
        self.design = design_matrix(knots, points, degree)
        rough = design_matrix(knots, points, degree, PENALTY_ORDER).astype(np.float64)
        normal = (self.design.T @ self.design).astype(np.float64)
        # Regularise basis functions with few samples (narrow last spans): keeps the matrix
        # definite.
        normal[np.diag_indices_from(normal)] += 1e-6 * float(np.max(np.diag(normal)))
        normal += smoothing ** (2 * PENALTY_ORDER) * (rough.T @ rough)
        band = np.zeros((degree + 1, len(normal)))
        for i in range(degree + 1):
            band[i, : len(normal) - i] = np.diagonal(normal, -i)
        self.normal = normal.astype(np.float32)
        self._factor = (cholesky_banded(band, lower=True), True)

    def solve(self, values: NDArray[Any]) -> NDArray[np.float64]:
        return np.asarray(cho_solve_banded(self._factor, values))


def fit_spline(
    height: Floats,
    weight: Floats,
    resolution: float,
    knot_spacing: float,
    *,
    smoothing: float = 0.0,
    patches: bool = False,
    sweeps: int = 30,
) -> TensorSpline:
    """Fit a tensor B-spline to the cells of `height` where `weight` > 0 by least squares.

    With unit weights one separable solve gives the solution. With holes, conjugate gradients with
    the full grid's solve as preconditioner converge in some tens of iterations, where alternately
    filling the holes and refitting (a Richardson iteration with the same preconditioner) needs
    thousands. Control points without supporting cells keep the first fill (nearest cell outwards).

    The penalty on the third derivative along each axis makes the fit a low-pass filter with the
    response 1 / (1 + (smoothing w)^6) per axis, w in rad/m. Compared with wider knots it attenuates
    ridges less, does not depend on the knots' places, and stabilises the rim.

    Args:
        height: (ny, nx) metres; ignored where weight is 0.
        weight: (ny, nx) in [0, 1].
        resolution: metres between cells. Cell [0, 0] is at spline coordinates (0, 0).
        knot_spacing: target spacing of the knots, metres.
        smoothing: length of the penalty, metres; 0 for plain least squares.
        patches: fit the paper's independent 5 x 5 patches (2 * knot_spacing wide) instead of one
            surface.
        sweeps: limit of conjugate-gradient iterations.

    Raises:
        InputError: shapes disagree, or no cell has any weight.
    """
    if height.shape != weight.shape or height.ndim != 2:
        raise InputError(f"spline fit: height {height.shape} and weight {weight.shape} differ")
    mask = weight > 0.0
    if not mask.any():
        raise InputError("spline fit: no cell to fit to; is the garment's mask empty?")
    ny, nx = height.shape
    make_knots, degree = (patch_knots, PATCH_DEGREE) if patches else (open_uniform_knots, DEGREE)
    x = np.arange(nx, dtype=np.float64) * resolution
    y = np.arange(ny, dtype=np.float64) * resolution
    knots_x = make_knots(max(x[-1], knot_spacing), knot_spacing)
    knots_y = make_knots(max(y[-1], knot_spacing), knot_spacing)
    axis_x = _Axis(knots_x, x, degree, smoothing)
    axis_y = _Axis(knots_y, y, degree, smoothing)

    def project(residual: Floats) -> Floats:
        return _single(axis_y.design.T @ residual @ axis_x.design)

    def precondition(gradient: Floats) -> Floats:
        return axis_x.solve(axis_y.solve(gradient).T).T.astype(np.float32)

    def surface(control: Floats) -> Floats:
        return _single(axis_y.design @ control @ axis_x.design.T)

    def normal(control: Floats) -> Floats:
        filled = project(missing * surface(control))
        return _single(axis_y.normal @ control @ axis_x.normal) - filled

    control = precondition(project(_fill(height, mask)))
    missing = 1.0 - weight.astype(np.float32)
    if missing.any():
        gradient = project(weight * np.where(mask, height, np.float32(0.0))) - normal(control)
        control = _conjugate_gradients(control, gradient, normal, precondition, sweeps)
    return TensorSpline(knots_x, knots_y, control, degree)


def _conjugate_gradients(
    control: Floats, gradient: Floats, normal: Any, precondition: Any, sweeps: int
) -> Floats:
    direction = precondition(gradient)
    rho = float(np.vdot(gradient, direction))
    start = rho
    for _ in range(sweeps):
        if rho <= 1e-8 * start or rho <= 0.0:
            break
        image = normal(direction)
        step = rho / float(np.vdot(direction, image))
        control = control + np.float32(step) * direction
        gradient = gradient - np.float32(step) * image
        preconditioned = precondition(gradient)
        previous, rho = rho, float(np.vdot(gradient, preconditioned))
        direction = preconditioned + np.float32(rho / previous) * direction
    return control


def _single(values: NDArray[Any]) -> Floats:
    """Cast to float32 (numpy's stubs type a product of float32 arrays as float64)."""
    return np.asarray(values, dtype=np.float32)


def _fill(height: Floats, mask: NDArray[np.bool_]) -> Floats:
    """Set cells outside the mask to the height of the nearest cell inside."""
    if mask.all():
        return height
    _, labels = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    values = np.zeros(int(labels.max()) + 1, dtype=np.float32)
    values[labels[mask]] = height[mask]
    return values[labels]
