"""A node of ROS 2 for collabslam; what it does is `collabslam.live.ros`."""
