"""What a batch keeps from run to run: the fields, with the pages that were made of them."""

import json
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path

from swath.core.random import Stream
from swath.field.solid.obstacles import things_of
from swath.runtime.field_setup import Ground, build_field
from swath.scenario.resolved import FieldSection

MOST = 4  # fields in memory


class KeptFields:
    """The fields that were used last.

    A run whose scenario has the same field and seed gets one of them as it was at the start, without a look
    at its files.
    """

    def __init__(self) -> None:
        self._grounds: OrderedDict[str, Ground] = OrderedDict()

    def ground(self, section: FieldSection, seed: int, base: Path, *, is_cut: bool = True) -> Ground:
        """As `build_field`, for the stream of a scenario's seed. What it gives before becomes its again."""
        key = json.dumps([section.plain(), seed, str(base), is_cut], default=str)
        kept = self._grounds.pop(key, None)
        if kept is None:
            kept = build_field(section, stream=Stream(seed, "field"), base=base, is_cut=is_cut)
            kept.field.keep_pages()
            while len(self._grounds) >= MOST:
                self._grounds.popitem(last=False)
        else:
            kept.field.profile, kept.field.plumes = None, {}  # levels ask for them anew
            kept.field.reset()
            kept.asked.begin_again()
            kept = replace(kept, things=things_of(section.obstacles, kept.field))
        self._grounds[key] = kept
        return kept
