"""Levels of looking at the crop ahead: how much of it there is."""
