"""Levels of unloading: the auger of a grain tank, and its stream of grain."""
