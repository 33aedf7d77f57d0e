"""Process levels: what becomes of the crop inside the machine."""
