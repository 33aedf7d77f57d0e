"""Sensors: a folder per slot, a file per level; beam and echo models."""
