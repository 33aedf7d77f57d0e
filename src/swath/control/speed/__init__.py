"""Speed laws: a wanted forward speed."""
