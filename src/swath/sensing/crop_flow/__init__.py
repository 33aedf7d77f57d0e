"""Levels of the sensors on the crop's way: feeder layer, yield, grain moisture, tank level, losses."""
