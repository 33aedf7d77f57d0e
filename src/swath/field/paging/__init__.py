"""Pages of the field: made where they are needed, forgotten, packed, and written to a file."""
