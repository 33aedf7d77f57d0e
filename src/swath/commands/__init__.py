"""The subcommands of `swath`: each module has `add(parsers)` and the function that it runs."""
