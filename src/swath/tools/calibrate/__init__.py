"""`swath calibrate`: fits the table of the LiDAR level `empirical`."""
