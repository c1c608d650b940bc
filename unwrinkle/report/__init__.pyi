from .calibration_pictures import save_residuals as save_residuals
from .live import LiveReplay as LiveReplay
from .page import write_report as write_report
from .replay import write_replay as write_replay
