"""Levels of the pose estimate: where the machine takes itself to be, by satellites, wheels and inertia."""
