"""Levels of the dust that a machine raises."""
