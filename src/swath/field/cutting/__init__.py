"""How crop is cut: the cells that a swept polygon covers, what stood on them, and the check of both."""
