"""Files for other tools.

| from | to | module |
|---|---|---|
| run log | MCAP with Foxglove's schemas | `foxglove_log` |
| run log | rerun recording `.rrd` | `rerun_log` |
| plan | ROS `trajectory_msgs/JointTrajectory`, as JSON or MCAP | `joint_trajectory` |
| range map | point cloud, PLY or PCD | `point_cloud` |

Lengths are in m, angles in rad, times in s. Frames are the world (z up, the robot looks along -y)
and the bodies of the cell by their scoped names, e.g. `r1::link_3`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
