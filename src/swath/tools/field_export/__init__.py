"""A field to take away: to Gazebo (SDF), Blender (GLB), or as a survey of it (LAS)."""
