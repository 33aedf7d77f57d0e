"""A whole field: its ground, one plan, one dispatcher, one schedule on ground that is granted.

In Python only: `swath fleet` runs `swath.job`. A field with a pond, or with many machines, may be refused for
want of room to wait or of a way.
"""
