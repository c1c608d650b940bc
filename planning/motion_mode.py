"""Modes of a controller that runs trajectories, on the robot and in the simulation."""

from enum import StrEnum


class MotionMode(StrEnum):
    """What a controller does with its trajectory."""

    IDLE = "idle"  # at rest, without a trajectory
    RUNNING = "running"
    HOLDING = "holding"  # brakes along the path, then rests
    FAULT = "fault"  # latched; nothing moves
