"""Solid things: obstacles, bodies of machines, and contact between them."""
