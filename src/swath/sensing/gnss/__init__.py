"""Levels of the satellite receiver: where its antenna is, how fast and where to it moves."""
