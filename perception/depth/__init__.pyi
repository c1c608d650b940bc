from .capture import Capture as Capture, load_capture as load_capture, save_capture as save_capture
from .range_mapping import (
    range_map_from_capture as range_map_from_capture,
    segment_capture as segment_capture,
)
from .segmentation import Segmentation as Segmentation, segment as segment
from .table_crop import crop_to_table as crop_to_table
from .table_plane import TableFit as TableFit, fit_table as fit_table
