"""Separation levels: grain out of the straw behind the drum."""
