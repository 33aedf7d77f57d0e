"""A machine's shape from the user's own file: URDF, SDF or a mesh."""
