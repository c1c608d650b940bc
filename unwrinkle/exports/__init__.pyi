from .foxglove_log import export_foxglove as export_foxglove
from .joint_trajectory import (
    export_trajectory as export_trajectory,
    joint_trajectory as joint_trajectory,
)
from .point_cloud import export_cloud as export_cloud
from .rerun_log import export_rerun as export_rerun
