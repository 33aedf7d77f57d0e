"""Returns levels: from the shoe back to the drum."""
