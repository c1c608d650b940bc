from .boards import RenderedBoard as RenderedBoard
from .image_noise import photograph_pair as photograph_pair
from .meshes import (
    height_field_mesh as height_field_mesh,
    rectangle_mesh as rectangle_mesh,
    towel_mesh as towel_mesh,
)
from .renderer import Renderer as Renderer
from .synthetic_towel import (
    Ridge as Ridge,
    Towel as Towel,
    capture_of as capture_of,
    wrinkled_towel as wrinkled_towel,
)
