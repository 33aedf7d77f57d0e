"""The page on which a run is watched again: its data, its bytes, and the page in a browser."""
