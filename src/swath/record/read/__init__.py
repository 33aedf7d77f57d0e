"""What was recorded, read back: run.mcap, any other MCAP file, rosbags of ROS 1 and 2."""
