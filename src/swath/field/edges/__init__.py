"""The crop edge: its track, what breaks it, the boundary of the crop, and where it stands now."""
