from .base import (
    DepthCamera as DepthCamera,
    DepthPicture as DepthPicture,
    PairCamera as PairCamera,
    PairPicture as PairPicture,
    expose as expose,
)
from .factory import open_cameras as open_cameras
from .folder import FolderCamera as FolderCamera, WatchCamera as WatchCamera
from .gphoto import GphotoCamera as GphotoCamera
from .opencv import OpenCvCamera as OpenCvCamera
from .openni import OpenNi2Camera as OpenNi2Camera
