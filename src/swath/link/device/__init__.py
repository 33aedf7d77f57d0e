"""Sensors as devices: their telegrams over TCP, UDP or a pseudo terminal, out of a run and into one."""
