"""Modes of a controller that runs trajectories, on the robot and in the simulation."""

from enum import StrEnum


class MotionMode(StrEnum):
    """What a controller does with its trajectory."""

    IDLE = "idle"  # at rest, without a trajectory
    RUNNING = "running"
    HOLDING = "holding"  # brakes along the path, then rests
    HELD = "held"  # at rest on the path, which can be resumed; a station reports idle
    FAULT = "fault"  # latched; nothing moves
