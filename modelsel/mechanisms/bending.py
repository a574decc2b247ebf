"""What yields under weight and is no drive: links, under what lies beyond them or under a payload, the
flange and what is bolted to it.

What hangs on the flange turns with it about the flange's own place, so that the target shifts by
the turn's moment about that: its place on the flange is among the causes."""

from __future__ import annotations

from collections.abc import Callable

from ..robot.gravity import G, declares_masses, find_gravity_joints
from ..robot.kinematics import Robot
from .beams import bend_beam, bend_tube, build_screws, can_bend, turn_end, twist_beam
from .bodies import find_line_end, list_bodies, list_main_bodies
from .causes import ONE, Cause, Combined, Named, Number
from .compliance import COMPLIANCE, HEAVY, SOURCE, UNKNOWN, WITH_PAYLOAD, later_frames, mass_choices
from .terms import Mechanism, Screw, Term

PAYLOAD = Named("payload_kg", "kg")
# N m of 1 kg a millimetre aside
OF_ONE_KG = Number(G / 1e3, "N m/kg mm")
# what is known of a payload on the flange and of what yields there: it hangs at the target (at the mean of
# several), and all axes yield alike; it hangs anywhere; and each axis has a stiffness of its own
AT_TARGET, ANYWHERE, EACH_AXIS = 0, 1, 2
# what bends: the end of a link, which turns; or, from these numbers on, the link all along, as a round tube
# or with a stiffness of its own against twist
TUBE, BEAM = 3, 6
# a link all along under masses that are not known, a number each: a tube, with masses at every joint beyond it
# and at the target, at the main ones alone, or at the end of its line alone; a beam with a twist of its own
OF_EACH, OF_MAIN, OF_ONE, OF_EACH_TWISTED = 4, 7, 10, 13
BENT_END, BENT_LINK = "flange or bolts at its end", "link that bends"
BENDING_PARTS = ("adapter or tool changer that bends", "flange or its bolts", "bracket of the load")
Bend = Callable[..., dict[str, Cause]]
# what moves the end, one a number: of an end that turns, of a tube, and of a beam with its own twist
FORMS: tuple[tuple[Bend, ...], ...] = ((turn_end,), (bend_tube,), (bend_beam, twist_beam))
# causes along x, y and z: None for nothing
Vector = tuple[Cause | None, ...]
# the target's place in the flange, that of a payload, and which way gravity pulls there
PLACE: Vector = tuple(Named(f"on_flange_{axis}_mm", "mm") for axis in "xyz")
HANGS: Vector = tuple(Named(f"load_on_flange_{axis}_mm", "mm") for axis in "xyz")
PULL: Vector = tuple(Named(f"down_{axis}") for axis in "xyz")
MINUS = Number(-1.0)


def find_bending_links(robot: Robot) -> tuple[int, ...]:
    """Find the links (numbered by the joint that moves them) that carry a later joint, where
    gravity is known."""
    if not find_gravity_joints(robot):
        return ()
    links = range(1, robot.n)
    return tuple(links)


def list_bendings(robot: Robot, link: int) -> tuple[int, ...]:
    """List what may bend of a link, and what is known of the masses beyond it: known ones, with the
    payload where they are declared, and unknown ones. With these only the end is tried where masses are
    declared: a beam with a number for each mass would take the shape of many other errors."""
    joint = link + 1
    ends = mass_choices(robot, joint)
    if not can_bend(robot, link):
        return ends
    known = [masses for masses in ends if masses != UNKNOWN]
    bent = [form + masses for form in _list_beams(robot, link) for masses in known]
    if not declares_masses(robot):
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
    f = link + 1
    form, masses = divmod(bending, TUBE)
    of_payload = masses == WITH_PAYLOAD
    if masses == UNKNOWN and form:
        return _bend_by_each(robot, link, bending)
    terms = []
    for symbol, bend in zip("bw", FORMS[form], strict=False):
        held = {}
        if of_payload:
            held = bend(robot, link, robot.n + 1)
        own = bend(robot, link)
        screws = build_screws(f, own, held, PAYLOAD)
        term = Term(f"{symbol}{link}", screws, COMPLIANCE, 1)
        terms.append(term)
    if masses == UNKNOWN:
        terms = _turn_by_each(robot, link)
    payload = " and of the payload, with the masses as declared" if of_payload else ""
    weight = f"weight beyond it{payload}"
    return Mechanism(
        f"link-bending:{link}",
        tuple(terms),
        _describe(link, weight, form),
        _equate(f, weight, form),
        SOURCE,
        usual_causes=_list_parts(link, form),
    )


def _turn_by_each(robot: Robot, link: int) -> list[Term]:
    """List the terms of a link's end that turns with masses that are not known, one a frame."""
    f = link + 1
    terms = []
    for k in later_frames(robot, f):
        turned = turn_end(robot, link, k)
        screws = build_screws(f, turned)
        term = Term(f"b{link}m{k}", screws, HEAVY, 1)
        terms.append(term)
    return terms


def _bend_by_each(robot: Robot, link: int, bending: int) -> Mechanism:
    """Build a link that bends all along under masses that are not known, a term each.

    Masses beside the lines between the joints may have more moment than at these: of many masses that at
    the link's own end, which has none, takes the difference, and may be less than nothing."""
    f = link + 1
    bodies = list_bodies(robot, link)
    unsigned = {f}
    if bending == OF_MAIN:
        bodies, unsigned = list_main_bodies(robot, link), set()
    if bending == OF_ONE:
        bodies = (find_line_end(robot, link),)
    form = 1
    if bending == OF_EACH_TWISTED:
        form = 2
    terms = []
    for symbol, bend in zip("bw", FORMS[form], strict=False):
        for k in bodies:
            bent = bend(robot, link, k)
            screws = build_screws(f, bent)
            if screws:
                sign = int(k not in unsigned)
                term = Term(f"{symbol}{link}m{k}", screws, HEAVY, sign)
                terms.append(term)
    frames = ", ".join(map(str, bodies))
    weight = f"weight beyond it, of masses that are not known at frames {frames}"
    return Mechanism(
        f"link-bending:{link}",
        tuple(terms),
        _describe(link, "weight beyond it", form),
        _equate(f, weight, form),
        SOURCE,
        usual_causes=_list_parts(link, form),
    )


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
    form = load // TUBE
    terms = []
    for symbol, bend in zip("bw", FORMS[form], strict=False):
        held = bend(robot, link, robot.n + 1)
        screws = build_screws(f, {}, held, PAYLOAD)
        term = Term(f"{symbol}{link}p", screws, COMPLIANCE, 1)
        terms.append(term)
    return Mechanism(
        f"payload-bending:{link}",
        tuple(terms),
        _describe(link, "payload", form),
        _equate(f, "payload at the target", form),
        SOURCE,
        usual_causes=_list_parts(link, form),
    )


def _describe(link: int, weight: str, form: int) -> str:
    """Describe what a link does under a weight, in a sentence."""
    if form:
        numbers = len(FORMS[form])
        bends = "bends and twists" if numbers > 1 else "bends"
        return (
            f"Link {link} {bends} as a beam does, under the moment and the force of the {weight}."
        )
    return f"The far end of link {link} turns in proportion to the moment of the {weight}."


def _equate(frame: int, weight: str, form: int) -> str:
    """Write the equation of a link's end under a weight."""
    if not form:
        return f"rotation of frame {frame} = b · moment of the {weight}"
    twist = "and w · moment along it" if len(FORMS[form]) > 1 else "1.3 times as much about itself"
    return (
        f"rotation of frame {frame} = b (M + L × F / 2), {twist}, its shift = b (M / 2 + L × F / 3) × L, "
        f"with moment M there and force F of the {weight}, and the link's length L"
    )


def _list_parts(link: int, form: int) -> tuple[str, ...]:
    """List the parts that usually yield."""
    if form:
        return (BENT_LINK,)
    return BENT_LINK, BENT_END, f"bearing of joint {link + 1}"


def _bend_flange(robot: Robot, load: int) -> Mechanism:
    n = robot.n
    return Mechanism(
        f"payload-bending:{n}",
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
        moment = _cross(HANGS, PULL)
        screws = _turn_target(flange, moment, OF_ONE_KG)
        return [Term(f"b{n}p", screws, COMPLIANCE, 1)]
    terms = []
    for axis, name in enumerate("xyz"):
        if load == ANYWHERE:
            moment = _cross(_along(axis, ONE), PULL)
            terms.append(Term(f"b{n}p{name}", _turn_target(flange, moment), HEAVY))
            continue
        for pull in (axis + 1) % 3, (axis + 2) % 3:
            moment = _along(axis, PULL[pull])
            symbol = f"b{n}p{name}{'xyz'[pull]}"
            terms.append(Term(symbol, _turn_target(flange, moment), HEAVY))
    return terms


def _along(axis: int, cause: Cause | None) -> Vector:
    causes: list[Cause | None] = [None, None, None]
    causes[axis] = cause
    return tuple(causes)


def _turn_target(flange: int, turn: Vector, scale: Cause = ONE) -> tuple[Screw, ...]:
    """Build the screws of the target's frame that turn it about the flange's place by a vector
    times the payload and a number."""
    screws = []
    for kind, causes in (("r", turn), ("t", _cross(turn, PLACE))):
        for axis, cause in zip("xyz", causes, strict=True):
            loaded = _multiply(PAYLOAD, cause)
            scaled = _multiply(loaded, scale)
            if scaled is not None:
                screws.append(Screw(flange, f"{kind}{axis}", scaled))
    return tuple(screws)


def _cross(left: Vector, right: Vector) -> Vector:
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
