"""The shape of the source: what additions touch, where things are, how large files are."""
