"""`swath test search`: the boundary of failure of a case."""
