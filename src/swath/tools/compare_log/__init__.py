"""`swath compare log`: a machine model against a recorded log."""
