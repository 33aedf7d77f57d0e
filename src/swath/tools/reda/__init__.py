"""Where sensors detect a person in crop and weather: the question of a Real Environment Detection Area."""
