"""Show the loop in a live Meshcat.

The moving robot and cloth, the head's images, the wrinkles and the plan.

Meshcat sends from a thread of its own, so that no call waits for a browser.
"""

import time as clock
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.wrinkles.analysis import Analysis
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.viewer.plan_shapes import ridge_shapes, target_shapes
from unwrinkle.viewer.scene import CellScene, in_first_view, rgba
from unwrinkle.viewer.text_panel import picture_panel, text_panel

#: Maximum updates per second of wall-clock time; earlier ones are skipped.
RATE = 25.0
_CLOTH = np.array([0.27, 0.49, 0.72])
#: Direction to a light from the side: with light from the viewer or from everywhere, folds would
#: hardly be visible.
_LIGHT = np.array([-0.62, -0.35, 0.70])
_INK = "#3b4654"


class LiveView:
    """View of a cell, its cloth and the loop's results in a Meshcat."""

    def __init__(self, cell: Cell, meshcat: Any, triangles: NDArray[Any] | None) -> None:
        """Send the cell.

        Args:
            cell: cell to show.
            meshcat: Meshcat to show it in; see `scene.start_meshcat`.
            triangles: (m, 3) indices of the cloth's vertices; None for no cloth.

        Raises:
            InputError: the triangles have another shape, or the cell's models cannot be read.
        """
        faces = np.zeros((0, 3)) if triangles is None else np.asarray(triangles)
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise InputError(f"the cloth's triangles have shape {faces.shape}; (m, 3) is required")
        self.meshcat = meshcat
        self._scene = CellScene(cell, meshcat, proximity=False)
        self._faces = np.ascontiguousarray(faces.T.astype(np.int32))
        self._next = 0.0
        self._q = np.zeros(0)
        self._cloth = np.zeros((0, 3))
        self._lines: tuple[str, ...] = ()

    def update(
        self,
        axes: Array,
        head: Array,
        openings: Array,
        vertices: NDArray[np.floating[Any]] | None = None,
        *,
        force: bool = False,
    ) -> bool:
        """Show a posture and the cloth; unchanged parts are not sent again.

        Args:
            axes: (13,) rad.
            head: (4,) left pan, tilt, right pan, tilt, rad.
            openings: (2,) openings of the right and the left gripper, m.
            vertices: (n, 3) vertices of the cloth, world frame, m; None keeps the shown ones.
            force: whether to send also if the last update was less than 1 / `RATE` ago.

        Returns:
            Whether anything was sent.
        """
        now = clock.perf_counter()
        if now < self._next and not force:
            return False
        self._next = now + 1.0 / RATE
        scene = self._scene
        scene.move(axes, openings)
        q = scene.positions()
        q[scene.indices.head] = head
        sent = False
        if not np.array_equal(q, self._q):
            scene.set_positions(q)
            scene.publish()
            self._q = q
            sent = True
        if vertices is not None and self._faces.size and not np.array_equal(vertices, self._cloth):
            self._cloth = np.array(vertices)
            colours = shaded(self._cloth, self._faces)
            self.meshcat.SetTriangleColorMesh(
                "loop/cloth", self._cloth.T.astype(float), self._faces, colours
            )
            sent = True
        return sent

    def show_look(self, left: NDArray[np.uint8] | None, right: NDArray[np.uint8] | None) -> None:
        """Show the head's images, (h, w, 3) RGB, on panels on both sides of the table.

        None removes one.
        """
        for name, picture, across in (("left", left, -0.66), ("right", right, 0.66)):
            path = f"loop/{name} eye"
            if picture is None:
                self.meshcat.Delete(path)
                continue
            self.meshcat.SetObject(path, picture_panel(picture, 0.52))
            self.meshcat.SetTransform(path, in_first_view(across, -0.86, 3.0))

    def show_analysis(self, analysis: Analysis | None, chosen: int | None = None) -> None:
        """Show the wrinkles, the chosen one in red; None removes them."""
        self.meshcat.Delete("loop/wrinkles")
        if analysis is not None:
            curves = [wrinkle.curve for wrinkle in analysis.wrinkles]
            for path, mesh, colour in ridge_shapes(curves, chosen):
                self._mesh(f"loop/wrinkles/{path}", mesh, colour)

    def show_plan(self, plan: FlatteningPlan | None) -> None:
        """Show the planned grasps and pulls; None removes them."""
        self.meshcat.Delete("loop/plan")
        if plan is not None:
            for path, mesh, colour in target_shapes(plan):
                self._mesh(f"loop/plan/{path}", mesh, colour)

    def status(self, lines: Sequence[str]) -> None:
        """Show lines on a text panel at the upper left of the first view.

        An empty list removes it.
        """
        text = tuple(line for line in lines if line)
        if text == self._lines:
            return
        self._lines = text
        if not text:
            self.meshcat.Delete("loop/status")
            return
        self.meshcat.SetObject(
            "loop/status", text_panel([(line, _INK) for line in text], 0.08 * len(text) + 0.08)
        )
        self.meshcat.SetTransform("loop/status", in_first_view(-0.52, 0.60, 3.0))

    def _mesh(self, path: str, mesh: tuple[Array, NDArray[np.int32]], colour: str) -> None:
        vertices, faces = mesh
        self.meshcat.SetTriangleMesh(path, vertices.T, faces.T, rgba(colour))


def shaded(vertices: Array, faces: NDArray[np.int32]) -> Array:
    """Return the colours (3, n) of vertices (n, 3) in the light from the side; faces (3, m)."""
    x, y, z = np.ascontiguousarray(vertices.T, dtype=float)
    i, j, k = faces
    u = x[j] - x[i], y[j] - y[i], z[j] - z[i]
    v = x[k] - x[i], y[k] - y[i], z[k] - z[i]
    up = u[0] * v[1] - u[1] * v[0]
    turn = np.where(up < 0.0, -1.0, 1.0)
    across = turn * (u[1] * v[2] - u[2] * v[1]), turn * (u[2] * v[0] - u[0] * v[2]), turn * up
    corners = faces.ravel()
    total = np.stack([np.bincount(corners, np.tile(n, 3), len(x)) for n in across])
    slant = _LIGHT @ total / np.maximum(np.linalg.norm(total, axis=0), 1e-15)
    light = 0.2 + 0.95 * np.maximum(slant, 0.0) ** 2
    return np.asarray(np.clip(_CLOTH[:, None] * light, 0.0, 1.0))
