"""What yields under weight and is no drive: links, under what lies beyond them or under a payload, the
flange and what is bolted to it.

What hangs on the flange turns with it about the flange's own place, so that the target shifts by
the turn's moment about that: its place on the flange is among the causes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..robot.gravity import G, declares_masses_beyond, find_gravity_joints
from ..robot.kinematics import Robot
from .beams import bend_beam, bend_tube, build_screws, can_bend, turn_end, twist_beam
from .bodies import find_line_end, list_bodies, list_main_bodies
from .causes import ONE, Cause, Combined, Named, Number
from .compliance import (
    ANYWHERE,
    AT_TARGET,
    COMPLIANCE,
    DECLARED,
    HEAVY,
    SOURCE,
    UNKNOWN,
    WITH_PAYLOAD,
    later_frames,
    mass_choices,
    say_place,
)
from .terms import Mechanism, Screw, Term

LINK_BENDING, PAYLOAD_BENDING = "link-bending", "payload-bending"
PAYLOAD = Named("payload_kg", "kg")
# N m of 1 kg a millimetre aside
OF_ONE_KG = Number(G / 1e3, "N m/kg mm")
# a payload on the flange hangs anywhere, and each axis has a stiffness of its own; else all axes yield alike
EACH_AXIS = 2
# what bends a link, by numbers that results keep: the end alone, by what is known of the masses (`compliance`);
# the link all along, as a round tube or with a stiffness of its own against twist
TUBE, TUBE_WITH_PAYLOAD, BEAM, BEAM_WITH_PAYLOAD = 3, 5, 6, 8
# the same under masses that are not known: a tube, with masses at every joint beyond it and at the target, at
# the main ones alone, or at the end of its line alone; a beam with a twist of its own
OF_EACH, OF_MAIN, OF_ONE, OF_EACH_TWISTED = 4, 7, 10, 13
# what bends all along under the masses that are declared, and the same under these and the payload
UNDER_BOTH = {TUBE: TUBE_WITH_PAYLOAD, BEAM: BEAM_WITH_PAYLOAD}
BENT_END, BENT_LINK = "flange or bolts at its end", "link that bends"
BENDING_PARTS = ("adapter or tool changer that bends", "flange or its bolts", "bracket of the load")
Bend = Callable[..., dict[str, Cause]]
# causes along x, y and z: None for nothing
Vector = tuple[Cause | None, ...]
# the target's place in the flange, that of a payload, and which way gravity pulls there
PLACE: Vector = tuple(Named(f"on_flange_{axis}_mm", "mm") for axis in "xyz")
HANGS: Vector = tuple(Named(f"load_on_flange_{axis}_mm", "mm") for axis in "xyz")
PULL: Vector = tuple(Named(f"down_{axis}") for axis in "xyz")
MINUS = Number(-1.0)


def _list_later(robot: Robot, link: int) -> Sequence[int]:
    """List the frames beyond a link's end where a mass may sit."""
    end = link + 1
    return later_frames(robot, end)


def _list_line_end(robot: Robot, link: int) -> Sequence[int]:
    """List the frame at the end of a link's line alone."""
    end = find_line_end(robot, link)
    return (end,)


class Form(NamedTuple):
    """How a link bends, and under which masses.

    `bends`: what moves its end, one a number; `bodies`: where masses sit that are not known, of a robot and a
    link; `of_payload`: whether the payload bends it besides."""

    bends: tuple[Bend, ...]
    bodies: Callable[[Robot, int], Sequence[int]] | None = None
    of_payload: bool = False

    @property
    def is_end(self) -> bool:
        """Whether the end alone yields."""
        return self.bends == END


END: tuple[Bend, ...] = (turn_end,)
AS_TUBE: tuple[Bend, ...] = (bend_tube,)
AS_BEAM: tuple[Bend, ...] = bend_beam, twist_beam
FORMS = {
    DECLARED: Form(END),
    UNKNOWN: Form(END, _list_later),
    WITH_PAYLOAD: Form(END, of_payload=True),
    TUBE: Form(AS_TUBE),
    TUBE_WITH_PAYLOAD: Form(AS_TUBE, of_payload=True),
    BEAM: Form(AS_BEAM),
    BEAM_WITH_PAYLOAD: Form(AS_BEAM, of_payload=True),
    OF_EACH: Form(AS_TUBE, list_bodies),
    OF_MAIN: Form(AS_TUBE, list_main_bodies),
    OF_ONE: Form(AS_TUBE, _list_line_end),
    OF_EACH_TWISTED: Form(AS_BEAM, list_bodies),
}


def find_bending_links(robot: Robot) -> tuple[int, ...]:
    """Find the links (numbered by the joint that moves them) that carry a later joint, where
    gravity is known."""
    if not find_gravity_joints(robot):
        return ()
    links = range(1, robot.n)
    return tuple(links)


def list_bendings(robot: Robot, link: int) -> tuple[int, ...]:
    """List what may bend of a link, and what is known of the masses beyond it: known ones, with the
    payload where they are declared, and unknown ones. With these only the end is tried where all masses
    beyond it are declared: a beam with a number for each mass would take the shape of many other errors."""
    joint = link + 1
    ends = mass_choices(robot, joint)
    if not can_bend(robot, link):
        return ends
    bent = []
    for number in _list_beams(robot, link):
        bent.append(number)
        if WITH_PAYLOAD in ends:
            bent.append(UNDER_BOTH[number])
    if not declares_masses_beyond(robot, joint):
        bent += _list_unknown(robot, link)
    return (*ends, *bent)


def _list_unknown(robot: Robot, link: int) -> list[int]:
    """List how a link may bend all along under masses that are not known: none of the wrist's links, by
    which it would take the shape of many other errors."""
    each = list_bodies(robot, link)
    main = list_main_bodies(robot, link)
    if not main:
        return []
    bent = [OF_EACH]
    if main != each:
        bent.append(OF_MAIN)
    if find_line_end(robot, link) > link + 1:
        bent.append(OF_ONE)
    if BEAM in _list_beams(robot, link):
        bent.append(OF_EACH_TWISTED)
    return bent


def link_bending(robot: Robot, link: int, bending: int) -> Mechanism:
    """A link's far end turns in proportion to the moment there, with one stiffness; or it turns and
    shifts as the end of a beam does. Under the declared (or unit) masses, under unknown ones, a term
    each, or under the declared ones and the payload (`bending`: one of `list_bendings`)."""
    form = FORMS[bending]
    weight = "weight beyond it"
    if form.of_payload:
        weight = f"{weight} and of the payload, with the masses as declared"
    described = _describe(link, weight, form)
    if form.bodies is None:
        terms = _bend_by_all(robot, link, form)
    else:
        bodies = form.bodies(robot, link)
        terms = _bend_by_each(robot, link, form, bodies)
        if not form.is_end:
            frames = ", ".join(map(str, bodies))
            weight = f"{weight}, of masses that are not known at frames {frames}"
    return Mechanism(
        f"{LINK_BENDING}:{link}",
        tuple(terms),
        described,
        _equate(link + 1, weight, form),
        SOURCE,
        usual_causes=_list_parts(link, form),
    )


def _bend_by_all(robot: Robot, link: int, form: Form) -> list[Term]:
    """List the terms of a link that bends under all masses beyond it together."""
    end = link + 1
    target = robot.n + 1
    terms = []
    for symbol, bend in zip("bw", form.bends, strict=False):
        own = bend(robot, link)
        held = {}
        if form.of_payload:
            held = bend(robot, link, target)
        screws = build_screws(end, own, held, PAYLOAD)
        term = Term(f"{symbol}{link}", screws, COMPLIANCE, 1)
        terms.append(term)
    return terms


def _bend_by_each(robot: Robot, link: int, form: Form, bodies: Sequence[int]) -> list[Term]:
    """List the terms of a link that bends under masses that are not known, one for each that has a moment.

    Masses beside the lines between the joints may have more moment than at these: of many masses that at
    the link's own end, which has none, takes the difference, and may be less than nothing."""
    end = link + 1
    takes_difference = form.bodies is list_bodies
    terms = []
    for symbol, bend in zip("bw", form.bends, strict=False):
        for body in bodies:
            bent = bend(robot, link, body)
            screws = build_screws(end, bent)
            if not screws:
                continue
            sign = 1
            if body == end and takes_difference:
                sign = 0
            term = Term(f"{symbol}{link}m{body}", screws, HEAVY, sign)
            terms.append(term)
    return terms


def find_loaded_links(robot: Robot) -> tuple[int, ...]:
    """Find the links (numbered by the joint that moves them) that a payload may bend, the flange
    the last of them, where gravity is known."""
    if robot.gravity is None:
        return ()
    links = range(1, robot.n + 1)
    return tuple(links)


def list_loads(robot: Robot, link: int) -> tuple[int, ...]:
    """List what may be known of the payload and of the stiffness at a link's end, and whether the link
    bends all along."""
    if link == robot.n:
        if robot.payload_at_mm is not None:
            return (AT_TARGET,)
        return AT_TARGET, ANYWHERE, EACH_AXIS
    if can_bend(robot, link):
        return AT_TARGET, *_list_beams(robot, link)
    return (AT_TARGET,)


def _list_beams(robot: Robot, link: int) -> tuple[int, ...]:
    """List how a link may bend all along: with a twist of its own where weight may twist it, which an
    upright link that holds a slide never is."""
    if twist_beam(robot, link):
        return TUBE, BEAM
    return (TUBE,)


def payload_bending(robot: Robot, link: int, load: int) -> Mechanism:
    """A link bends, or its far end or the flange turns, in proportion to the moment of the payload
    there."""
    if link == robot.n:
        return _bend_flange(robot, load)
    f = link + 1
    form = FORMS[load]
    terms = []
    for symbol, bend in zip("bw", form.bends, strict=False):
        held = bend(robot, link, robot.n + 1)
        screws = build_screws(f, {}, held, PAYLOAD)
        term = Term(f"{symbol}{link}p", screws, COMPLIANCE, 1)
        terms.append(term)
    return Mechanism(
        f"{PAYLOAD_BENDING}:{link}",
        tuple(terms),
        _describe(link, "payload", form),
        _equate(f, f"payload {say_place(robot)}", form),
        SOURCE,
        usual_causes=_list_parts(link, form),
    )


def _describe(link: int, weight: str, form: Form) -> str:
    """Describe what a link does under a weight, in a sentence."""
    if form.is_end:
        return f"The far end of link {link} turns in proportion to the moment of the {weight}."
    bends = "bends"
    if form.bends == AS_BEAM:
        bends = "bends and twists"
    return f"Link {link} {bends} as a beam does, under the moment and the force of the {weight}."


def _equate(frame: int, weight: str, form: Form) -> str:
    """Write the equation of a link's end under a weight."""
    if form.is_end:
        return f"rotation of frame {frame} = b · moment of the {weight}"
    twist = "1.3 times as much about itself"
    if form.bends == AS_BEAM:
        twist = "and w · moment along it"
    return (
        f"rotation of frame {frame} = b (M + L × F / 2), {twist}, its shift = b (M / 2 + L × F / 3) × L, "
        f"with moment M there and force F of the {weight}, and the link's length L"
    )


def _list_parts(link: int, form: Form) -> tuple[str, ...]:
    """List the parts that usually yield."""
    if form.is_end:
        return BENT_LINK, BENT_END, f"bearing of joint {link + 1}"
    return (BENT_LINK,)


def _bend_flange(robot: Robot, load: int) -> Mechanism:
    n = robot.n
    return Mechanism(
        f"{PAYLOAD_BENDING}:{n}",
        tuple(_list_flange_terms(n, load)),
        "The flange, or what is bolted to it, turns in proportion to the moment of the payload.",
        "rotation of the flange = b · payload_kg · moment of 1 kg where the payload hangs",
        SOURCE,
        usual_causes=BENDING_PARTS,
    )


def _list_flange_terms(n: int, load: int) -> list[Term]:
    """List the terms of a flange that turns under a payload, for what is known of it."""
    flange = n + 1
    if load == AT_TARGET:
        moment = cross(HANGS, PULL)
        screws = turn_target(flange, moment, OF_ONE_KG)
        return [Term(f"b{n}p", screws, COMPLIANCE, 1)]
    terms = []
    for axis, name in enumerate("xyz"):
        if load == ANYWHERE:
            moment = cross(_along(axis, ONE), PULL)
            terms.append(Term(f"b{n}p{name}", turn_target(flange, moment), HEAVY))
            continue
        for pull in (axis + 1) % 3, (axis + 2) % 3:
            moment = _along(axis, PULL[pull])
            symbol = f"b{n}p{name}{'xyz'[pull]}"
            terms.append(Term(symbol, turn_target(flange, moment), HEAVY))
    return terms


def _along(axis: int, cause: Cause | None) -> Vector:
    causes: list[Cause | None] = [None, None, None]
    causes[axis] = cause
    return tuple(causes)


def turn_target(
    flange: int, turn: Vector, scale: Cause = ONE, load: Cause = PAYLOAD
) -> tuple[Screw, ...]:
    """Build the screws of the target's frame that turn it about the flange's place by a vector
    times the load and a number."""
    screws = []
    for kind, causes in (("r", turn), ("t", cross(turn, PLACE))):
        for axis, cause in zip("xyz", causes, strict=True):
            loaded = _multiply(load, cause)
            scaled = _multiply(loaded, scale)
            if scaled is not None:
                screws.append(Screw(flange, f"{kind}{axis}", scaled))
    return tuple(screws)


def cross(left: Vector, right: Vector) -> Vector:
    """Build the vector product of two vectors of causes."""
    product = []
    for j, k in ((1, 2), (2, 0), (0, 1)):
        first = _multiply(left[j], right[k])
        second = _multiply(left[k], right[j])
        product.append(_subtract(first, second))
    return tuple(product)


def _subtract(first: Cause | None, second: Cause | None) -> Cause | None:
    if second is None:
        return first
    if first is None:
        return _multiply(MINUS, second)
    is_negative, positive = _split(second)
    if is_negative:
        return first + positive
    return first - second


def _multiply(left: Cause | None, right: Cause | None) -> Cause | None:
    """Build the product of two causes, its sign first."""
    if left is None or right is None:
        return None
    one_negative, one = _split(left)
    other_negative, other = _split(right)
    product = one * other
    if one == ONE:
        product = other
    elif other == ONE:
        product = one
    if one_negative == other_negative:
        return product
    return MINUS * product


def _split(cause: Cause) -> tuple[bool, Cause]:
    """Split a cause's sign off."""
    if cause == MINUS:
        return True, ONE
    if isinstance(cause, Combined) and cause.left == MINUS:
        return True, cause.right
    return False, cause
