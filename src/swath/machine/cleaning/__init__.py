"""Cleaning levels: fan and sieves."""
