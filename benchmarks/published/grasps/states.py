"""Five states of cloth in which grasping gets harder, each from a seed."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from unwrinkle.models.cloth import load_material
from unwrinkle.models.robot import Cell
from unwrinkle.simulation.cloth import initial_states
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.outlines import outline

NODES = 80  # along the longer side


@dataclass(frozen=True)
class GraspState:
    """A kind of state.

    Attributes:
        name: in results.
        title: in tables.
        outline: of the garment.
        material: of the garment.
        start: maker of `initial_states`.
        pinches: for makers that push or drag repeatedly; None for the others.
    """

    name: str
    title: str
    outline: str
    material: str
    start: str
    pinches: int | None = None


# In this order more and more wrinkles cross, then layers lie on each other, and the cloth gets
# thinner and limper.
STATES = (
    GraspState("ridge", "towel, one ridge", "towel", "terry", "ridge"),
    GraspState("pushed", "towel, pushed together twice", "towel", "terry", "bunched", 2),
    GraspState("bunched", "towel, pushed together 5 times", "towel", "terry", "bunched", 5),
    GraspState("folded", "trousers, dragged into folds", "trousers", "cotton", "pinched", 5),
    GraspState("heap", "T-shirt, dropped in a heap", "tshirt", "jersey", "dropped"),
)


def state_named(name: str) -> GraspState:
    """Return the state of that name."""
    return next(state for state in STATES if state.name == name)


def cloth_of(kind: GraspState, cell: Cell) -> Cloth:
    """Return the solver of the state's garment on the cell's working table."""
    return Cloth(outline(kind.outline, NODES), load_material(kind.material), cell.table)


def start_of(kind: GraspState, cloth: Cloth, cell: Cell, seed: int, file: Path) -> ClothState:
    """Return the settled start, from its file if it is there; else make it and write it."""
    if file.exists():
        return ClothState.load(file)
    centre = (cell.scenario.garment_centre[0], cell.scenario.garment_centre[1])
    if kind.start == "ridge":
        state = initial_states.start_state(cloth, "ridge", centre, seed)
    elif kind.start == "dropped":
        state = initial_states.dropped(cloth, centre, seed)
    else:
        assert kind.pinches is not None
        maker = {"bunched": initial_states.bunched, "pinched": initial_states.pinched}[kind.start]
        state = maker(cloth, centre, seed, kind.pinches)
    state.save(file)
    return state


def layers(cloth: Cloth, covered: float) -> float:
    """Return how many layers lie on each other on average, from the covered area (m^2)."""
    return cloth.outline.area / covered if covered > 0.0 else float(np.inf)
