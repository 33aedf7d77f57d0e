"""Ray packets: neighbouring beams go through the crop together (docs/rays.md)."""
