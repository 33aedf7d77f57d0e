"""Cameras: levels of the slot `camera`."""
