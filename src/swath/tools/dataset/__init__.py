"""Labelled pictures of varied scenarios."""
