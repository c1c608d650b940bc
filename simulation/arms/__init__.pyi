from .trajectory_player import (
    PlayerLimits as PlayerLimits,
    PlayerSettings as PlayerSettings,
    PlayerState as PlayerState,
    TrajectoryPlayer as TrajectoryPlayer,
)
