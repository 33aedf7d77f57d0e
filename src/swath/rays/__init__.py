"""The ray engine: rays against plants, ground, heights and solids."""
