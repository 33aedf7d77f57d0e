"""Parts from elsewhere: ROS 2, FMI, CAN, OSI, recordings."""
