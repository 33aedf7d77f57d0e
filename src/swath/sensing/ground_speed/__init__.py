"""Ground speed levels: speed over ground without wheels."""
