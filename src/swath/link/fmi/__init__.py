"""Functional Mock-up Units (FMI 2 and 3, co-simulation) as parts of a machine."""
