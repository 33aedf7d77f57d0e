"""`swath scan`: one scan of a scenario, as a picture and files."""
