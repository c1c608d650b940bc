from .cloth import Cloth as Cloth
from .garment_mesh import ClothMesh as ClothMesh
from .initial_states import start_state as start_state
from .measures import TruthMeasures as TruthMeasures, measure as measure
from .outlines import Outline as Outline, outline as outline
from .pinch_grasp import catch as catch, lift as lift
from .state import ClothState as ClothState, Grip as Grip
