from .controller import ControllerDriverSystem as ControllerDriverSystem
from .depth_camera import DepthCameraDriverSystem as DepthCameraDriverSystem
from .grippers import GripperDriverSystem as GripperDriverSystem
from .pair_camera import PairCameraSystem as PairCameraSystem
from .pan_tilt import PanTiltDriverSystem as PanTiltDriverSystem
