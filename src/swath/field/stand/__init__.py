"""Levels of the stand."""
