from . import arms as arms
from . import cloth as cloth
from . import controllers as controllers
from . import depth_cameras as depth_cameras
from . import devices as devices
from . import rendering as rendering
