"""Powertrain levels: the engine, what takes its power, and how fast the drive can go."""
