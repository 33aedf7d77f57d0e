"""Feeder levels: from the knife to the drum."""
