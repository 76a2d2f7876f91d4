"""A robot's camera alone: with wheels or a gyroscope, metric by the wheels, or in a map of an earlier run.

ros2 launch collabslam_ros robot.launch.py cs:=/camera/image_raw cs_info:=/camera/camera_info \\
    twist:=/wheels/twist
"""

from collabslam_ros.launching import ROBOT, node_with


def generate_launch_description():
    """What ``ros2 launch`` starts."""
    return node_with(ROBOT)
