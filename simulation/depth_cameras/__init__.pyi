from .cameras import (
    depth_image as depth_image,
    depth_reading as depth_reading,
    load_depth_camera as load_depth_camera,
)
from .structured_light import StructuredLightCamera as StructuredLightCamera
from .time_of_flight import TimeOfFlightCamera as TimeOfFlightCamera
