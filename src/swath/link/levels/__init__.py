"""Levels for any slot played from outside: an FMU, a log, a ROS 2 node, a controller box. One file each."""
