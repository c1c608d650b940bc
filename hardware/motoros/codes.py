"""Numbers in the robot controller's messages, and their meaning for the user."""

from enum import IntEnum


class MessageType(IntEnum):
    """Types of messages; the bodies of the M-register, tool and DH messages are not implemented."""

    PING = 1
    ROBOT_STATUS = 13
    JOINT_TRAJ_PT_FULL = 14
    JOINT_FEEDBACK = 15
    MOTION_CTRL = 2001
    MOTION_REPLY = 2002
    READ_IO_BIT = 2003
    READ_IO_BIT_REPLY = 2004
    WRITE_IO_BIT = 2005
    WRITE_IO_BIT_REPLY = 2006
    READ_IO_GROUP = 2007
    READ_IO_GROUP_REPLY = 2008
    WRITE_IO_GROUP = 2009
    WRITE_IO_GROUP_REPLY = 2010
    IO_CTRL_REPLY = 2011
    READ_M_REGISTER = 2012
    WRITE_M_REGISTER = 2013
    JOINT_TRAJ_PT_FULL_EX = 2016
    JOINT_FEEDBACK_EX = 2017
    SELECT_TOOL = 2018
    GET_DH_PARAMETERS = 2020


class CommType(IntEnum):
    """Kinds of communication: unsolicited topic, request, reply."""

    TOPIC = 1
    REQUEST = 2
    REPLY = 3


class ReplyCode(IntEnum):
    """Reply code of a header; requests and topics carry INVALID."""

    INVALID = 0
    SUCCESS = 1
    FAILURE = 2


class Command(IntEnum):
    """Commands of a motion control message. CHECK_SYNCHRO exists on the CloPeMa controller only."""

    CHECK_MOTION_READY = 200101
    CHECK_QUEUE_COUNT = 200102
    CHECK_SYNCHRO = 200103
    STOP_MOTION = 200111
    START_SERVOS = 200112
    STOP_SERVOS = 200113
    RESET_ALARM = 200114
    START_TRAJ_MODE = 200121
    STOP_TRAJ_MODE = 200122
    DISCONNECT = 200130


class Result(IntEnum):
    """Results of a motion reply. BUSY: send the same point again."""

    SUCCESS = 0
    BUSY = 1
    FAILURE = 2
    INVALID = 3
    ALARM = 4
    NOT_READY = 5
    MP_FAILURE = 6


class Subcode(IntEnum):
    """Reasons for an invalid message (30xx), or a robot that is not ready (50xx)."""

    INVALID_UNSPECIFIED = 3000
    INVALID_SIZE = 3001
    INVALID_HEADER = 3002
    INVALID_TYPE = 3003
    INVALID_GROUP = 3004
    INVALID_SEQUENCE = 3005
    INVALID_COMMAND = 3006
    INVALID_DATA = 3010
    INVALID_START = 3011
    INVALID_POSITION = 3012
    INVALID_SPEED = 3013
    INVALID_ACCELERATION = 3014
    INVALID_INSUFFICIENT = 3015
    INVALID_TIME = 3016
    INVALID_TOOL = 3017
    NOT_READY_UNSPECIFIED = 5000
    NOT_READY_ALARM = 5001
    NOT_READY_ERROR = 5002
    NOT_READY_E_STOP = 5003
    NOT_READY_NOT_PLAY = 5004
    NOT_READY_NOT_REMOTE = 5005
    NOT_READY_SERVO_OFF = 5006
    NOT_READY_HOLD = 5007
    NOT_READY_NOT_STARTED = 5008
    NOT_READY_WAITING_ROS = 5009
    NOT_READY_SKILLSEND = 5010
    NOT_READY_FORCE_LIMIT = 5011
    NOT_READY_INCREMENT_MOVE = 5012


class IoResult(IntEnum):
    """Results of reading or writing inputs and outputs."""

    OK = 0
    READ_ADDRESS = 1001
    WRITE_ADDRESS = 1002
    WRITE_VALUE = 1003
    READ_FAILURE = 1004
    WRITE_FAILURE = 1005


#: Meaning of each sub-code of a motion reply, and what to try.
SUBCODES: dict[int, str] = {
    3000: "the message is invalid, no reason given",
    3001: "the message has a wrong size; is the profile (groups or ex) the controller's?",
    3002: "the message's header is wrong",
    3003: "the controller does not know this type of message; try the other profile",
    3004: "there is no such control group; compare the site's groups with the controller's",
    3005: "the point's sequence number is not the one expected; stop and start the trajectory anew",
    3006: (
        "the controller does not know this command; if it is the check of synchrony, set synchro: "
        "off"
    ),
    3010: "a number in the message is invalid",
    3011: "the first point is not where the robot is commanded to stand; plan from where it stands",
    3012: "a position is out of its axis' range",
    3013: (
        "a speed is above its axis' limit, or the controller's speed governor "
        "(controller.speed_cap); slow down"
    ),
    3014: "an acceleration is above its axis' limit; slow the trajectory down",
    3015: "data is missing: a point needs time, positions and velocities",
    3016: "the point's time is invalid: not increasing, or four hours or more",
    3017: "there is no such tool",
    5000: "the robot is not ready, no reason given; see the pendant",
    5001: "the controller shows an alarm; clear its cause, then reset it on the pendant",
    5002: "the controller shows an error; acknowledge it on the pendant",
    5003: "an emergency stop is pressed; release it, then reset",
    5004: "the pendant is in teach mode, not in play; turn its key to play",
    5005: "the controller is not in remote; turn the pendant's key to remote",
    5006: "the servos are off; start trajectory mode again",
    5007: "the pendant's hold is pressed; release it",
    5008: "the controller's job is not started; see the pendant for the INFORM job",
    5009: "trajectory mode is not started, or the job waits elsewhere",
    5010: "the controller's job has not reached its SKILLSND line; see the INFORM job",
    5011: "power and force limiting is active; see the pendant",
    5012: "the controller could not move by increments; stop, and start trajectory mode again",
}
#: Meaning of each result of reading or writing inputs and outputs.
IO_RESULTS: dict[int, str] = {
    0: "done",
    1001: "there is no input or output of this address to read",
    1002: (
        "this address cannot be written; general outputs are 10010 to 12567, last digit at most 7"
    ),
    1003: "this value cannot be written",
    1004: "the controller failed to read it",
    1005: "the controller failed to write it",
}
_RESULTS: dict[int, str] = {
    0: "done",
    1: "busy: the point before is still on its way to the queue",
    2: "no, or it failed",
    3: "the message is invalid",
    4: "the controller shows an alarm; clear its cause, then reset it on the pendant",
    5: "the robot is not ready",
    6: "a call inside the controller failed",
}


def describe(result: int, subcode: int = 0) -> str:
    """Return the meaning of a motion reply, with its numbers and what to try.

    The sub-code is only a reason where the result is a refusal; elsewhere it may be a count.
    """
    text = _RESULTS.get(result, "the controller answers with an unknown result")
    if result in (Result.INVALID, Result.NOT_READY):
        text = SUBCODES.get(subcode, text)
    numbers = f"{result}" if subcode == 0 or result in (0, 1) else f"{result}/{subcode}"
    return text if result == Result.SUCCESS else f"{text} (reply {numbers})"
