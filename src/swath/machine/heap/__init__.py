"""Levels of a heap of grain in an open box."""
