"""A robot's camera and one that a person wears; metric wherever both look at the same place.

ros2 launch collabslam_ros worn.launch.py cs:=/robot/image_raw cs_info:=/robot/camera_info \\
    cf:=/glasses/image/compressed cf_info:=/glasses/camera_info t_cf:=/t_cf
"""

from collabslam_ros.launching import ROBOT, WORN, node_with


def generate_launch_description():
    """What ``ros2 launch`` starts."""
    return node_with({**ROBOT, **WORN})
