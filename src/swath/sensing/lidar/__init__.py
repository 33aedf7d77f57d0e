"""LiDAR levels: sibling files with the same ports."""
