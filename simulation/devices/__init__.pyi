from .can_gripper import VirtualCanGrippers as VirtualCanGrippers
from .digital_grippers import VirtualDigitalGrippers as VirtualDigitalGrippers
from .pan_tilt import VirtualPanTilt as VirtualPanTilt
from .serial_pan_tilt import PtyPort as PtyPort, VirtualSerialPanTilt as VirtualSerialPanTilt
