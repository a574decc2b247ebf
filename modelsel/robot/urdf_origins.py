"""Other origins in the text of a URDF: names, meshes, masses, limits, comments, order and white
space stay as they are."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree as ET
from xml.parsers import expat

import numpy as np

from .._typing import Array
from .kinematics import UrdfSource
from .rigid import align_z, inverse, to_rpy, transform
from .urdf import parse_urdf
from .urdf_chain import find_chain
from .urdf_elements import child_of, is_moving, read_axis, read_origin

# mm and entries of a rotation: an origin that changes by less keeps its text
SAME_ORIGIN = 1e-9
ATTRIBUTE = re.compile(r"""\s([^\s="'<>]+)\s*=\s*("[^"]*"|'[^']*')""")
# what of a start tag lies before its end: quoted values may hold a >
START_TAG = re.compile(rb"""<(?:[^<>"']|"[^"]*"|'[^']*')*?(?=/?>)""")


def replace_origins(source: UrdfSource, before: Sequence[Array]) -> str:
    """Return the text with other origins of the chain's moving joints; `before` (n, 4, 4) the
    transforms [mm] that lead to them, as in `Robot.joints`. Fixed joints and axes stay."""
    root = parse_urdf(source.text, "the URDF")
    chain = find_chain(root, "the URDF", source.base, source.tip)
    origins = _find_origins(chain, before)
    return _write_origins(source.text, origins)


def _find_origins(chain: Sequence[ET.Element], before: Sequence[Array]) -> dict[str, Array]:
    """Find the new origins (4, 4), by the link that hangs on the joint."""
    origins = {}
    # from the frame that the axis turns about, to where this joint's origin starts
    pending = np.eye(4)
    wanted = iter(before)
    for element in chain:
        origin = read_origin(element)
        if not is_moving(element):
            pending = pending @ origin
            continue
        axis = read_axis(element)
        to_axis = transform(align_z(axis))
        lead = next(wanted)
        new = inverse(pending) @ lead @ inverse(to_axis)
        change = np.abs(new - origin)
        if change.max() > SAME_ORIGIN:
            link = child_of(element)
            origins[link] = new
        pending = inverse(to_axis)
    return origins


@dataclass
class _Place:
    """Where a joint's origin stands in the bytes of a file: the start tags of both, the origin's
    absent where there is none."""

    joint: int
    origin: int | None = None
    child: str | None = None


@dataclass
class _Places:
    """Places of the joints of a robot, as expat meets their tags."""

    parser: expat.XMLParserType
    found: list[_Place] = field(default_factory=list)
    path: list[str] = field(default_factory=list)

    def start(self, name: str, attributes: Mapping[str, str]) -> None:
        depth = len(self.path)
        inside = self.path[-1] if self.path else ""
        self.path.append(name)
        at = self.parser.CurrentByteIndex
        if depth == 1 and name == "joint":
            place = _Place(at)
            self.found.append(place)
        if depth != 2 or inside != "joint":
            return
        place = self.found[-1]
        if name == "origin" and place.origin is None:
            place.origin = at
        if name == "child" and place.child is None:
            place.child = attributes.get("link")

    def end(self, name: str) -> None:
        self.path.pop()


def _find_places(content: bytes) -> list[_Place]:
    parser = expat.ParserCreate("utf-8")
    places = _Places(parser)
    parser.StartElementHandler = places.start
    parser.EndElementHandler = places.end
    parser.Parse(content, True)
    return places.found


def _write_origins(text: str, origins: Mapping[str, Array]) -> str:
    """Write origins (4, 4), each by its child link, into a text; from its end on, so that places
    stay valid."""
    content = text.encode()
    for place in reversed(_find_places(content)):
        if place.child is None or place.child not in origins:
            continue
        origin = origins[place.child]
        at = place.joint if place.origin is None else place.origin
        tag = START_TAG.match(content, at)
        assert tag is not None, "expat found a tag here"
        written = tag.group().decode()
        end = tag.end()
        if place.origin is None:
            # behind the joint's start tag
            end += 1
            new_tag = f"{written}><origin{_format_attributes(origin)}/>"
        else:
            new_tag = _replace_attributes(written, origin)
        content = content[:at] + new_tag.encode() + content[end:]
    return content.decode()


def _format_numbers(origin: Array) -> dict[str, str]:
    """Format an origin (4, 4) [mm] as the attributes of a URDF: metres and radians, in full."""
    offset = origin[:3, 3] / 1e3
    angles = to_rpy(origin[:3, :3])
    return {"xyz": " ".join(map(repr, offset.tolist())), "rpy": " ".join(map(repr, angles))}


def _format_attributes(origin: Array) -> str:
    numbers = _format_numbers(origin)
    return "".join(f' {key}="{value}"' for key, value in numbers.items())


def _replace_attributes(tag: str, origin: Array) -> str:
    """Replace the numbers of an origin's start tag, without its end; what it lacks is added."""
    numbers = _format_numbers(origin)
    pieces = []
    copied = 0
    for attribute in ATTRIBUTE.finditer(tag):
        value = numbers.pop(attribute[1], None)
        if value is None:
            continue
        start, end = attribute.span(2)
        quote = tag[start]
        pieces += [tag[copied:start], quote, value, quote]
        copied = end
    rest = tag[copied:]
    words = rest.rstrip()
    added = "".join(f' {key}="{value}"' for key, value in numbers.items())
    return "".join([*pieces, words, added, rest[len(words) :]])
