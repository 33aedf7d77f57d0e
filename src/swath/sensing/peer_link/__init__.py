"""Levels of the link between machines that work together."""
