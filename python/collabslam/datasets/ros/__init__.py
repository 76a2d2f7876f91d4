"""ROS 1 and ROS 2 bags: recordings read from and written to them."""
