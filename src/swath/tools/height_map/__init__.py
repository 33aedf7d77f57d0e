"""From measured scans to the grid of heights that the LiDAR level `replay` looks at."""
