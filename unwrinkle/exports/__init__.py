"""Files for other tools.

- `foxglove_log`: a run log as MCAP with Foxglove's schemas; `rerun_log`: as a rerun recording.
- `joint_trajectory`: a plan as ROS `trajectory_msgs/JointTrajectory`, JSON or MCAP.
- `point_cloud`: a range map as a point cloud, PLY or PCD.

Lengths are in m, angles in rad, times in s. Frames are the world (z up, the robot looks along -y)
and the bodies of the cell by their scoped names, e.g. `r1::link_3`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
