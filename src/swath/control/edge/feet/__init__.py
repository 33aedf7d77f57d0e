"""How far the feet of the crop stand behind the edge of its canopy."""
