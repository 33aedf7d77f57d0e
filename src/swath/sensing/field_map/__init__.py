"""Field map levels: what is known of the crop ahead before any sensor sees it."""
