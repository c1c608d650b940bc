from .base import (
    DepthCamera as DepthCamera,
    DepthPicture as DepthPicture,
    PairCamera as PairCamera,
    PairPicture as PairPicture,
    expose as expose,
)
from .factory import (
    CAMERAS as CAMERAS,
    CameraKind as CameraKind,
    make_cameras as make_cameras,
    make_depth_camera as make_depth_camera,
)
from .folder import FolderCamera as FolderCamera, WatchCamera as WatchCamera
from .gphoto import GphotoCamera as GphotoCamera
from .opencv import OpenCvCamera as OpenCvCamera
from .openni import OpenNi2Camera as OpenNi2Camera
