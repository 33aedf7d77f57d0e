"""Ray packets: neighbouring beams go through the crop together (docs/explanation/lidar.md)."""
