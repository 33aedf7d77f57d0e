"""The box of the machine beside, from the truth."""
