"""`swath part`: one slot of a scenario on its own, fed from a table or a recording."""
