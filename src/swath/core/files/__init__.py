"""Files and folders: how they are opened, written whole, kept for a while."""
