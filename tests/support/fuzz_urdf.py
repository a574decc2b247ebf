"""Broken URDFs: entities, circles, axes, joints that follow others, numbers and bytes."""

from __future__ import annotations

import copy
from xml.etree import ElementTree as ET

import numpy as np
from fuzz_tables import bytes_broken
from fuzz_words import ANY, REFUSED, SAME, Mutant

ENTITY = (
    '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">'
    + "".join(
        f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    )
    + "]>"
)
OUTSIDE = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd"><!ENTITY % y SYSTEM "http://localhost:1/x"> %y;]>'
NUMBERS = (
    "nan",
    "inf",
    "1e308 0 0",
    "1e308",
    "0 0 0",
    "-0 0 1",
    "1 2",
    "1 2 3 4",
    "",
    "a b c",
    "1,2,3",
    "1e-320 0 0",
    "２ 0 0",
    "0 0 1_0",
    "1e30 1e30 1e30",
)


def urdf_mutant(text: str, rng: np.random.Generator) -> Mutant:
    what = rng.random()
    if what < 0.12:
        return bytes_broken(text.encode(), rng)
    if what < 0.2:
        head, body = text.split("\n", 1)
        bomb = [ENTITY, OUTSIDE, "<!DOCTYPE r>"][int(rng.integers(3))]
        return Mutant(
            "document type or entities",
            f"{head}\n{bomb}\n{body.replace('base', '&i;', 1)}".encode(),
            REFUSED,
            (2,),
        )
    if what < 0.24:
        how = str(rng.choice(["utf-16", "utf-7", "cp500"]))
        return Mutant(
            f"encoded as {how}",
            text.replace("utf-8", how).encode(how),
            REFUSED if how != "utf-7" else ANY,
            (2,),
        )
    if what < 0.28:
        deep = int(rng.choice([100, 10_000, 200_000]))
        return Mutant(
            "nested deeply",
            text.replace("</robot>", "<a>" * deep + "</a>" * deep + "</robot>").encode(),
            ANY,
        )
    root = ET.fromstring(text)
    name, expect = _URDF[int(rng.integers(len(_URDF)))](root, rng)
    exits = (2,) if expect == REFUSED else (2, 3, 4)
    return Mutant(
        name, ET.tostring(root, encoding="unicode").encode("utf-8", "surrogatepass"), expect, exits
    )


def _any(root: ET.Element, rng: np.random.Generator, tag: str | None = None) -> ET.Element:
    found = [e for e in root.iter(tag) if e is not root]
    return found[int(rng.integers(len(found)))]


def _moving(root: ET.Element, rng: np.random.Generator) -> ET.Element:
    found = [e for e in root.iter("joint") if e.get("type") != "fixed"]
    return found[int(rng.integers(len(found)))]


def _attribute(root: ET.Element, rng: np.random.Generator) -> tuple[str, str]:
    found = [e for e in root.iter() if e.attrib]
    element = found[int(rng.integers(len(found)))]
    key = str(rng.choice(list(element.attrib)))
    element.set(key, str(rng.choice(NUMBERS)))
    return f"attribute of <{element.tag}> changed", ANY


def _gone(root: ET.Element, rng: np.random.Generator) -> tuple[str, str]:
    holders = [e for e in root.iter() if len(e)]
    holder = holders[int(rng.integers(len(holders)))]
    child = holder[int(rng.integers(len(holder)))]
    holder.remove(child)
    return f"<{child.tag}> left out", ANY


def _twice(root: ET.Element, rng: np.random.Generator) -> tuple[str, str]:
    child = copy.deepcopy(_any(root, rng, "joint"))
    root.append(child)
    return "joint twice", REFUSED


def _cycle(root: ET.Element, rng: np.random.Generator) -> tuple[str, str]:
    links = [str(e.get("name")) for e in root.iter("link")]
    joint = ET.SubElement(root, "joint", name="again", type=str(rng.choice(["fixed", "revolute"])))
    ET.SubElement(joint, "parent", link=str(rng.choice(links)))
    ET.SubElement(joint, "child", link=str(rng.choice(links)))
    return "links in a circle", REFUSED


DIAMONDS = "".join(
    f'<link name="d{k + 1}"/>'
    + "".join(
        f'<joint name="d{k}{side}" type="fixed"><parent link="{f"d{k}" if k else "flange"}"/><child link="d{k + 1}"/></joint>'
        for side in "ab"
    )
    for k in range(40)
)  # two ways to every next link: as many paths as there are numbers of 40 bits


def _diamonds(root: ET.Element, rng: np.random.Generator) -> tuple[str, str]:
    root.extend(ET.fromstring(f"<robot>{DIAMONDS}</robot>"))
    return "two ways to each link", REFUSED


def _axis(root: ET.Element, rng: np.random.Generator) -> tuple[str, str]:
    axis = _moving(root, rng).find("axis")
    assert axis is not None
    if rng.random() < 0.5:
        axis.set("xyz", "0 0 0")
        return "axis without length", REFUSED
    axis.set("xyz", f"0 0 {rng.choice([2.0, 1e-3, 1e3])}")
    return "axis of another length", SAME


def _mimic(root: ET.Element, rng: np.random.Generator) -> tuple[str, str]:
    ET.SubElement(_moving(root, rng), "mimic", joint="joint1", multiplier="2")
    return "joint that mimics another", REFUSED


def _kind(root: ET.Element, rng: np.random.Generator) -> tuple[str, str]:
    kind = str(rng.choice(["floating", "planar", "revolut", "", "Revolute", "spherical"]))
    _moving(root, rng).set("type", kind)
    return "joint of an unknown kind", REFUSED


def _orphan(root: ET.Element, rng: np.random.Generator) -> tuple[str, str]:
    parent = _moving(root, rng).find("parent")
    assert parent is not None
    parent.set("link", str(rng.choice(["nowhere", "", "flange"])))
    return "parent missing", REFUSED


def _long(root: ET.Element, rng: np.random.Generator) -> tuple[str, str]:
    """A tail of fixed links: the same arm."""
    last = "flange"
    for k in range(int(rng.choice([5, 300]))):
        joint = ET.SubElement(root, "joint", name=f"tail{k}", type="fixed")
        ET.SubElement(joint, "parent", link=last)
        ET.SubElement(joint, "child", link=f"tail{k}")
        ET.SubElement(root, "link", name=f"tail{k}")
        last = f"tail{k}"
    return "long tail of fixed links", SAME


_URDF = (
    _attribute,
    _attribute,
    _attribute,
    _gone,
    _gone,
    _twice,
    _cycle,
    _diamonds,
    _axis,
    _mimic,
    _kind,
    _orphan,
    _long,
)
