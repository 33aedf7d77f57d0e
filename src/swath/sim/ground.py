"""The field of a scenario: its parts made by their levels and put together."""

from pathlib import Path

from swath.core.random import Stream
from swath.field.crop import load_crop
from swath.field.edge import make_boundary, make_edge
from swath.field.field import Field, make_field
from swath.field.layout import Solids
from swath.field.setup import FieldSetup
from swath.field.solids import make_obstacles
from swath.sim.choices import FieldSection


def build_field(section: FieldSection, *, stream: Stream, base: Path) -> tuple[Field, Solids]:
    """The field and what stands on it. base: folder that relative file names start from."""
    setup = FieldSetup(stream=stream, folder=base)
    assert section.terrain is not None
    assert section.stand is not None
    stand = section.stand.make(setup)
    field = make_field(
        section.terrain.make(setup),
        stand,
        make_edge(section.edge, setup),
        crop=load_crop(stand.crop),
        stream=stream,
        boundary=make_boundary(section.boundary),
    )
    return field, make_obstacles(section.obstacles, field)
