from .model import CellModel as CellModel
from .verdict import PairClearance as PairClearance, Verdict as Verdict
from .verifier import cell_model as cell_model, verify as verify
