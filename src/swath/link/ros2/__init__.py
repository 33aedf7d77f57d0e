"""ROS 2 by plain rclpy: the samples of a run as topics, a run under services, slots played by nodes.

docs/ros2.md is the page for users. Nothing here is imported before it is needed: rclpy is an optional part.
"""
