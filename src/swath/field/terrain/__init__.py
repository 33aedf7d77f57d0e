"""Levels of the terrain."""
