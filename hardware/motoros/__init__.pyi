from .io_channel import IoChannel as IoChannel
from .tcp_link import TcpLink as TcpLink
from .motion_channel import MotionChannel as MotionChannel
from .codes import MessageType as MessageType
from .frames import Framer as Framer, Message as Message
from .messages import MotionReply as MotionReply, TrajectoryPoint as TrajectoryPoint
