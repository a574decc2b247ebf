"""What turns under a payload and is no drive: the far ends of links, the flange and what is bolted
to it.

What hangs on the flange turns with it about the flange's own place, so that the target shifts by
the turn's moment about that: its place on the flange is among the causes."""

from __future__ import annotations

from ..robot.gravity import G
from ..robot.kinematics import Robot
from .causes import ONE, Cause, Combined, Named, Number
from .compliance import COMPLIANCE, HEAVY, SOURCE, weight_moment
from .terms import Mechanism, Screw, Term

PAYLOAD = Named("payload_kg", "kg")
# N m of 1 kg a millimetre aside
OF_ONE_KG = Number(G / 1e3, "N m/kg mm")
# what is known of a payload on the flange and of what yields there: it hangs at the target, and all
# axes yield alike; it hangs anywhere; and each axis has a stiffness of its own
AT_TARGET, ANYWHERE, EACH_AXIS = 0, 1, 2
BENDING_PARTS = ("adapter or tool changer that bends", "flange or its bolts", "bracket of the load")
# causes along x, y and z: None for nothing
Vector = tuple[Cause | None, ...]
# the target's place in the flange, and which way gravity pulls there
PLACE: Vector = tuple(Named(f"on_flange_{axis}_mm", "mm") for axis in "xyz")
PULL: Vector = tuple(Named(f"down_{axis}") for axis in "xyz")
MINUS = Number(-1.0)


def find_loaded_links(robot: Robot) -> tuple[int, ...]:
    """Find the links (numbered by the joint that moves them) that a payload may bend, the flange
    the last of them, where gravity is known."""
    if robot.gravity is None:
        return ()
    links = range(1, robot.n + 1)
    return tuple(links)


def list_loads(robot: Robot, link: int) -> tuple[int, ...]:
    """List what may be known of the payload and of the stiffness at a link's end."""
    if link == robot.n:
        return AT_TARGET, ANYWHERE, EACH_AXIS
    return (AT_TARGET,)


def payload_bending(robot: Robot, link: int, load: int) -> Mechanism:
    """A link's far end, or the flange, turns in proportion to the moment of the payload there."""
    if link == robot.n:
        return _bend_flange(robot, load)
    f = link + 1
    # a slide has a force along z, and no moment about it
    axes = "xy" if robot.joints[link].prismatic else "xyz"
    screws = []
    for axis in axes:
        moment = weight_moment(f, axis, robot.n + 1)
        screws.append(Screw(f, f"r{axis}", PAYLOAD * moment))
    return Mechanism(
        f"payload-bending:{link}",
        (Term(f"b{link}p", tuple(screws), COMPLIANCE, 1),),
        f"The far end of link {link} turns in proportion to the moment of the payload.",
        f"rotation of frame {f} = b · payload_kg · moment of 1 kg at the target",
        SOURCE,
        usual_causes=("link that bends", "flange or bolts at its end", f"bearing of joint {f}"),
    )


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
        moment = _cross(PLACE, PULL)
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
