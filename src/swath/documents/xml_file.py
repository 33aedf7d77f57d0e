"""XML of others as elements: no entities, no DOCTYPE, no depth without end."""

from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from swath.core.errors import reason_of

DEPTH_MAX = 64  # elements within each other


class XmlError(ValueError):
    """Not such XML. line: where it stops."""

    def __init__(self, reason: str, line: int) -> None:
        super().__init__(f"line {line}: {reason}")
        self.reason, self.line = reason, line


def read_xml(data: bytes, depth_max: int = DEPTH_MAX) -> Element:
    """The root element; names keep their prefix. Raises XmlError."""
    builder, depth = TreeBuilder(), 0
    parser = expat.ParserCreate()

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > depth_max:
            raise ValueError(f"more than {depth_max} elements within each other")
        builder.start(name, attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    def refuse(*_: Any) -> None:
        raise ValueError("a DOCTYPE is not allowed")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = builder.data, refuse
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, LookupError, ValueError) as error:  # LookupError: an unknown encoding
        raise XmlError(reason_of(error), parser.CurrentLineNumber) from error
    return builder.close()
