"""What a run harvested, as the yield log of a monitor."""
