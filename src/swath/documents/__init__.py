"""Documents of the user: YAML in which every key keeps its place, validation, data sheets."""
