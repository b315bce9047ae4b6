"""Bags of ROS 1 and ROS 2, and MCAP: messages sensor_msgs/Imu."""
