"""What a page carries in itself."""

import base64
import re

from swath.replay.writer import unpacked


def data_of(page):
    """Values and arrays of a replay.html."""
    text = page.read_text(encoding="utf-8")
    return unpacked(base64.b64decode(re.search(r'<script id="data"[^>]*>([^<]*)<', text).group(1)))
