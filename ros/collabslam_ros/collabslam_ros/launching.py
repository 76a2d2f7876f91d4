"""What the launch files share: topics and files are arguments, settings are in the file of parameters."""

from __future__ import annotations

from collections.abc import Mapping

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

Arguments = Mapping[str, tuple[str, str]]
"""Defaults and help, by the parameter's name."""

ROBOT: Arguments = {
    "cs": ("/camera/image_raw", "images of Cs, the robot's camera"),
    "cs_info": ("/camera/camera_info", "their CameraInfo"),
    "base": ("", "where Cs sits on base_link: X,Y,Z[,R,P,Y], or tf:base_link:camera_optical"),
    "odometry": ("", "the robot's odometry, nav_msgs/Odometry"),
    "twist": ("", "the same as TwistWithCovarianceStamped"),
    "gyro": ("", "its gyroscope, sensor_msgs/Imu"),
    "imu": ("", "how that sits: a file, or axes (optical, opengl, ros); tf tells it otherwise"),
    "map": ("", "a map to start in"),
    "save_map": ("collabslam.map", "where the service save_map writes it"),
    "tf": ("all", "links that are sent: all, map (the wheels' node sends odom -> base_link), none"),
}
WORN: Arguments = {
    "cf": ("/glasses/image/compressed", "images of Cf, the worn camera"),
    "cf_info": ("/glasses/camera_info", "their CameraInfo"),
    "t_cf": ("/t_cf", "T_CF: a topic of PoseWithCovarianceStamped, /tf, or sensors:FILE"),
    "t_cf_sd": ("", "with /tf: its standard deviations, METRES,DEGREES"),
    "worn_gyro": ("", "Cf's own gyroscope, sensor_msgs/Imu"),
    "worn_imu": ("", "how that sits: a file, or axes (optical, opengl, ros); tf tells it otherwise"),
}


def node_with(arguments: Arguments) -> LaunchDescription:
    """The node, with these arguments as its parameters; and RViz, if asked for."""
    share = FindPackageShare("collabslam_ros")
    given = {name: ParameterValue(LaunchConfiguration(name), value_type=str) for name in arguments}
    return LaunchDescription(
        [
            DeclareLaunchArgument(name, default_value=default, description=text)
            for name, (default, text) in arguments.items()
        ]
        + [
            DeclareLaunchArgument("parameters", default_value=[share, "/config/collabslam.yaml"]),
            DeclareLaunchArgument("rviz", default_value="false", description="true opens RViz"),
            Node(
                package="collabslam_ros",
                executable="collabslam_node",
                name="collabslam",
                output="screen",
                parameters=[LaunchConfiguration("parameters"), given],
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", [share, "/rviz/collabslam.rviz"]],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
