from .cell_view import CellView as CellView
from .live_view import LiveView as LiveView
from .overlay import PreviewSummary as PreviewSummary, closed_page as closed_page
from .plan_shapes import (
    ridge_shapes as ridge_shapes,
    target_shapes as target_shapes,
    wrinkle_shapes as wrinkle_shapes,
)
from .preview import LivePreview as LivePreview, preview_page as preview_page
from .scene import (
    CellScene as CellScene,
    follow as follow,
    in_first_view as in_first_view,
    rgba as rgba,
    start_meshcat as start_meshcat,
)
