"""Levels of the box of the machine beside: where its rim is and how grain lies in it."""
