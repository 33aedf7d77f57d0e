"""Tools around a run, each with its computation, its page and its command together."""
