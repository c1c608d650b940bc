from .boards import (
    Board as Board,
    BoardView as BoardView,
    NoBoard as NoBoard,
    find_board as find_board,
    load_grey as load_grey,
)
from .files import (
    find_board_pairs as find_board_pairs,
    find_pairs as find_pairs,
    save_record as save_record,
)
from .hand_eye import angle_between as angle_between
from .head import HeadFit as HeadFit, HeadView as HeadView, calibrate_head as calibrate_head
from .stereo import (
    PairView as PairView,
    StereoCalibration as StereoCalibration,
    calibrate_stereo as calibrate_stereo,
)
