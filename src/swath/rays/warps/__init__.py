"""Rays in groups on a card: one warp for some neighbouring beams (docs/rays.md)."""
