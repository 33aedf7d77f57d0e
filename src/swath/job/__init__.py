"""The whole job of a harvest: plan of a field, turns, and machines that work it off until it is empty."""
