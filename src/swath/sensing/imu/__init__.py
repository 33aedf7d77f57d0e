"""Levels of the inertial measurement unit: angular rates and specific forces on the machine."""
