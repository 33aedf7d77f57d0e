"""One physical case per slot through all its levels, each held to the tolerance that it states."""
