"""ROS 2 with plain rclpy: signals as topics, services that control a run, slots played by nodes.

docs/how-to/ros2.md is the page for users. rclpy is optional and imported where it is used.
"""
