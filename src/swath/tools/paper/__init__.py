"""The figures of the paper that swath implements, made anew by runs on this machine."""
