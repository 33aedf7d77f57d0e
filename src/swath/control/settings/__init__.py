"""Settings levels: how drum, concave, fan, sieves and vanes of a combine are set."""
