"""Rays in groups: neighbouring beams walk through the crop together (docs/rays.md)."""
