"""`swath calibrate`: fits the table of the LiDAR level `empirical`, and the engine of a machine."""
