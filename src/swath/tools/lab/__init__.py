"""`swath lab`: what scanners measure over stands that are known."""
