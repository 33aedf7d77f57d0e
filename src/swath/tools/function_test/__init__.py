"""`swath test`: function tests. Cases with varied parameters and seeds, run many times and judged."""
