"""Write the evidence as `evidence.html` (one self-contained page) and `evidence.json`."""

import base64
import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from unwrinkle.evidence.pack import Evidence, assumptions
from unwrinkle.evidence.swept import SweptSpace
from unwrinkle.models.io.files import write_json, write_text
from unwrinkle.models.robot import Cell
from unwrinkle.site.sites import site_cell
from unwrinkle.viewer.pages import filled_page

PAGE = "evidence.html"
RECORD = "evidence.json"
_COLOURS = ((0.45, 0.50, 0.56), (0.85, 0.11, 0.38), (0.12, 0.53, 0.90), (0.55, 0.36, 0.71))
#: Views: name, world axes to the right and upwards, and the axis along which they look.
_VIEWS = (("from above", 0, 1, 2), ("from the robot's left", 1, 2, 0), ("from the front", 0, 2, 1))


def write_evidence(evidence: Evidence, folder: str | Path) -> tuple[Path, Path]:
    """Write both files into a folder, made if missing; return their paths.

    Raises:
        InputError: a file cannot be written there.
    """
    folder = Path(folder)
    page = evidence_page(evidence)
    write_json(folder / RECORD, evidence.to_json())
    write_text(folder / PAGE, page)
    return folder / PAGE, folder / RECORD


def evidence_page(evidence: Evidence) -> str:
    """Return the page as text; it needs no other file and makes no request."""
    share = evidence.speed
    return filled_page(
        "unwrinkle.evidence",
        PAGE,
        e=evidence,
        data=evidence.to_json(),
        share=share,
        verdict=evidence.verdict,
        assumptions=assumptions(evidence),
        picture=_data_url(_picture(evidence.space, site_cell(evidence.site))),
    )


def _data_url(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


def _picture(space: SweptSpace, cell: Cell) -> bytes:
    """Draw the swept space in three views, with the working table."""
    figure = Figure(figsize=(13.0, 4.8))
    FigureCanvasAgg(figure)
    low, high = space.bounds()
    table = cell.table
    below = np.array([*table.centre, table.height]) - 0.5 * np.array([*table.size, 0.0])
    over = np.array([*table.centre, table.height]) + 0.5 * np.array([*table.size, 0.0])
    low = np.minimum(np.minimum(low, below), 0.0) - 0.1
    high = np.maximum(np.maximum(high, over), 0.0) + 0.1
    for number, (name, right, up, along) in enumerate(_VIEWS):
        axes = figure.add_axes((0.05 + 0.325 * number, 0.16, 0.27, 0.74))
        _view(axes, space, right, up, along)
        size = over - below
        axes.add_patch(
            Rectangle(
                (below[right], below[up]), size[right], size[up], fill=False, lw=1.8, ec="#7a5200"
            )
        )
        mirrored = along == 2  # the robot at the lower edge, as in the other pictures
        axes.set_xlim((high[right], low[right]) if mirrored else (low[right], high[right]))
        axes.set_ylim((high[up], low[up]) if mirrored else (low[up], high[up]))
        axes.set_aspect("equal")
        axes.set_title(name, fontsize=10)
        axes.set_xlabel(f"{'xyz'[right]} (m)")
        axes.set_ylabel(f"{'xyz'[up]} (m)")
        axes.grid(alpha=0.3)
        axes.tick_params(labelsize=8)
    handles = [Patch(color=c, label=g) for g, c in zip(space.groups, _COLOURS, strict=False)]
    handles.append(Patch(fill=False, ec="#7a5200", label="working table"))
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), fontsize=9)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


def _view(axes: Axes, space: SweptSpace, right: int, up: int, along: int) -> None:
    """Fill the shadows of the groups' voxels."""
    first = space.origin
    last = first + space.resolution * np.array(space.passed.shape[1:])
    for grid, colour in zip(space.passed, _COLOURS, strict=False):
        shadow = grid.any(axis=along)  # the two axes left are in the order x, y, z
        image = np.zeros((*shadow.T.shape, 4))
        image[shadow.T] = (*colour, 0.55)
        axes.imshow(
            image,
            extent=(first[right], last[right], first[up], last[up]),
            origin="lower",
            interpolation="nearest",
        )
