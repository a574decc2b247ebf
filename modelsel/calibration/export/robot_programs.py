"""Joint commands as programs of robot controllers: URScript, KRL, RAPID, Fanuc's LS, and targets
for RoboDK.

A program holds numbers and a name that was checked. Foreign text stands in comments alone, in plain
letters of ASCII on one line."""

from __future__ import annotations

import re
import textwrap
import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..._typing import Array
from ...exceptions import StudyError
from .point_names import MAX_TEXT, make_distinct, write_as_text, write_as_words

# all that a comment may hold; none of it ends one, or means anything to an editor
PLAIN = re.compile(r"[^A-Za-z0-9 .,:+=()_-]+")
MAX_COMMENT = 100  # characters of a line
# words of the languages that no program may be called, and RAPID's points
RESERVED = re.compile(
    r"and|bool|case|char|const|continue|decl|def|deffct|default|do|else|elseif|elif|end|endfct|endfor"
    r"|endif|endproc|endmodule|error|exit|false|fine|for|func|global|goto|halt|if|import|int|lin|local"
    r"|loop|mod|module|none|not|or|pers|proc|ptp|real|record|repeat|return|signal|step|switch|test"
    r"|then|to|trap|true|until|var|wait|while|with|xor|p\d+",
    re.IGNORECASE,
)
# words of RAPID besides, and those that its program uses, which no point may be called
RESERVED_POINTS = re.compile(
    RESERVED.pattern.removesuffix(r"|p\d+")
    + r"|alias|backward|connect|div|endfunc|endrecord|endtest|endtrap|endwhile|from|inout|nostepin|noview"
    r"|raise|readonly|retry|sysmodule|task|trynext|undo|viewonly|moveabsj|jointtarget|v50|tool0|noeoffs",
    re.IGNORECASE,
)
MAX_LS_NAME = 16  # characters of a position's name
MAX_RAPID_NAME = 32


@dataclass(frozen=True)
class Program:
    """Commands to write: `values` (m, n) in degrees and mm, which joints slide, what to say of
    them in comments, and the names `points` of their rows, empty where they have none."""

    name: str
    values: Array
    slides: tuple[bool, ...]
    comments: tuple[str, ...]
    points: tuple[str, ...] = ()

    def rows(self, digits: int) -> list[list[str]]:
        """Return the numbers as text of so many decimals."""
        return [[f"{value:.{digits}f}" for value in row] for row in self.values.tolist()]

    def name_points(self, longest: int = MAX_TEXT) -> list[str]:
        """Return the points' names as plain text."""
        names = self.points or ("",) * len(self.values)
        return write_as_text(names, longest)


@dataclass(frozen=True)
class Language:
    """How commands are written for one controller: the decimals of a joint value and its unit, how
    many joints a program can have, and whether they may slide; the longest name of a program."""

    title: str
    write: Callable[[Program], str]
    digits: int
    joints: tuple[int, int]
    may_slide: bool = False
    max_name: int = 32
    radians: bool = False


def write_program(
    form: str,
    path: Path,
    q: Array,
    slides: Sequence[bool],
    comments: Sequence[str],
    points: Sequence[str] = (),
) -> str:
    """Write commands q (m, n) [rad, mm] as a program that is called as its file is, its `points`
    under their names where they have any. Raises StudyError where the language has no such name, or no such joints."""
    language = LANGUAGES[form]
    name = path.stem
    _check_name(language, path)
    _check_joints(language, slides)
    plain = list[str]()
    for comment in comments:
        plain += _plain_lines(comment, MAX_COMMENT)
    values = _to_unit(language, q, slides)
    lines = tuple(plain)
    named = tuple(points)
    program = Program(name, values, tuple(slides), lines, named)
    return language.write(program)


def round_commands(form: str, q: Array, slides: Sequence[bool]) -> Array:
    """Return commands q (m, n) [rad, mm] as they come back from a program's decimals."""
    language = LANGUAGES[form]
    commands = _to_unit(language, q, slides)
    rounded = np.round(commands, language.digits)
    if language.radians:
        return rounded
    return np.where(slides, rounded, np.radians(rounded))


def _to_unit(language: Language, q: Array, slides: Sequence[bool]) -> Array:
    if language.radians:
        return q
    return np.where(slides, q, np.degrees(q))


def _check_name(language: Language, path: Path) -> None:
    name = path.stem
    is_word = re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name, re.ASCII)
    is_short = len(name) <= language.max_name
    is_reserved = RESERVED.fullmatch(name)
    if is_word and is_short and not is_reserved:
        return
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")
    advice = plain[: language.max_name].rstrip("_")
    if not advice[:1].isalpha() or RESERVED.fullmatch(advice):
        advice = f"commands_{plain}"[: language.max_name].rstrip("_")
    raise StudyError(
        f"--out {path.name}: a program in {language.title} is called as its file is: a letter, then "
        f"letters, digits or _, {language.max_name} at most, and not a reserved word. Call it "
        f"{advice}{path.suffix}."
    )


def _check_joints(language: Language, slides: Sequence[bool]) -> None:
    least, most = language.joints
    count = len(slides)
    if not least <= count <= most:
        expected = f"{most}" if least == most else f"{least} to {most}"
        raise StudyError(
            f"a program in {language.title} moves {expected} joints, and the robot has {count}. Use "
            "--format csv or robodk."
        )
    if any(slides) and not language.may_slide:
        number = list(slides).index(True) + 1
        raise StudyError(
            f"joint {number} slides, and a joint command in {language.title} has angles alone. Use "
            "--format csv or robodk."
        )


def _plain_lines(text: str, width: int) -> list[str]:
    """Return a text as comment lines: letters without their accents, all else than PLAIN a
    space."""
    decomposed = unicodedata.normalize("NFKD", text)
    letters = "".join(c for c in decomposed if not unicodedata.combining(c))
    parts = letters.replace(";", ",")
    words = PLAIN.sub(" ", parts).split()
    return textwrap.wrap(" ".join(words), width)


# -- the languages
# --------------------------------------------------------------------------------------------


def _write_urscript(program: Program) -> str:
    """Write a URScript function: angles in rad, slow moves that stop at every point."""
    lines = [f"def {program.name}():"]
    lines += [f"  # {comment}" for comment in program.comments]
    language = LANGUAGES["urscript"]
    rows = program.rows(language.digits)
    for name, values in zip(program.name_points(), rows, strict=True):
        listed = ", ".join(values)
        remark = f"  # {name}" if name else ""
        lines.append(f"  movej([{listed}], a=0.5, v=0.25){remark}")
    lines.append("end")
    text = "\n".join(lines)
    return text + "\n"


def _write_krl(program: Program) -> str:
    """Write a KRL module (.src): axis angles in degrees, at a tenth of the speed."""
    lines = ["&ACCESS RVP", "&REL 1", f"DEF {program.name}( )"]
    lines += [f"; {comment}" for comment in program.comments]
    lines += [";FOLD INI", "BAS (#INITMOV,0 )", ";ENDFOLD (INI)", "BAS (#VEL_PTP,10 )"]
    rows = program.rows(LANGUAGES["krl"].digits)
    for name, values in zip(program.name_points(), rows, strict=True):
        axes = [f"A{k} {value}" for k, value in enumerate(values, 1)]
        remark = f" ; {name}" if name else ""
        lines.append(f"PTP {{{','.join(axes)}}}{remark}")
    lines.append("END")
    return "\r\n".join(lines) + "\r\n"


def _write_rapid(program: Program) -> str:
    """Write a RAPID module: jointtargets in degrees, no external axes, slow moves that stop at
    every point."""
    lines = [f"MODULE {program.name}"]
    lines += [f"  ! {comment}" for comment in program.comments]
    rows = program.rows(LANGUAGES["rapid"].digits)
    external = ",".join(["9E9"] * 6)
    points = _name_rapid_points(program)
    for point, values in zip(points, rows, strict=True):
        axes = ",".join(values + ["0"] * (6 - len(values)))
        lines.append(f"  CONST jointtarget {point}:=[[{axes}],[{external}]];")
    lines.append(f"  PROC run_{program.name}()")
    lines += [f"    MoveAbsJ {point}\\NoEOffs,v50,fine,tool0;" for point in points]
    lines += ["  ENDPROC", "ENDMODULE"]
    return "\r\n".join(lines) + "\r\n"


def _name_rapid_points(program: Program) -> list[str]:
    """Name a program's points by words of the language; none is called as the program is."""
    own = f"|{program.name}|run_{program.name}"
    reserved = re.compile(RESERVED_POINTS.pattern + own, re.IGNORECASE)
    names = program.points or ("",) * len(program.values)
    words = write_as_words(names, MAX_RAPID_NAME, reserved)
    return make_distinct(words, "p", MAX_RAPID_NAME)


def _write_ls(program: Program) -> str:
    """Write a Fanuc teach-pendant program (LS): positions of joints in degrees and mm, at a tenth
    of the speed."""
    body = []
    for comment in program.comments:
        # a remark has 32 characters
        body += [f"  !{line}" for line in textwrap.wrap(comment, 30)]
    body += ["  UFRAME_NUM=0", "  UTOOL_NUM=1"]
    rows = program.rows(LANGUAGES["ls"].digits)
    names = program.name_points(MAX_LS_NAME)
    points = [f"{k}:{name}" if name else f"{k}" for k, name in enumerate(names, 1)]
    body += [f"J P[{point}] 10% FINE" for point in points]
    lines = [f"/PROG  {program.name.upper()}", "/ATTR", 'COMMENT\t\t= "modelsel";']
    lines += [f"LINE_COUNT\t= {len(body)};", "DEFAULT_GROUP\t= 1,*,*,*,*;", "/MN"]
    lines += [f"{k:4d}:{line}    ;" for k, line in enumerate(body, 1)]
    lines.append("/POS")
    for k, (name, values) in enumerate(zip(names, rows, strict=True), 1):
        point = f'{k}:"{name}"' if name else f"{k}"
        lines += [f"P[{point}]{{", "   GP1:", "\tUF : 0, UT : 1,\t"]
        lines += _format_ls_joints(values, program.slides)
        lines.append("};")
    lines.append("/END")
    return "\r\n".join(lines) + "\r\n"


def _format_ls_joints(values: Sequence[str], slides: Sequence[bool]) -> list[str]:
    """Format a position of joints, three to a line."""
    cells = []
    for k, (value, slide) in enumerate(zip(values, slides, strict=True), 1):
        unit = " mm" if slide else "deg"
        cells.append(f"\tJ{k}={value:>10} {unit}")
    lines = [",".join(cells[start : start + 3]) for start in range(0, len(cells), 3)]
    # every line but the last goes on
    return [f"{line}," for line in lines[:-1]] + lines[-1:]


ROBODK = '''"""{comments}

Run it in RoboDK (Tools, Run Script): it adds a joint target a command to the robot that you pick."""

from robodk.robolink import ITEM_TYPE_ROBOT, Robolink

# name, joints in degrees and mm
TARGETS = [
{rows}
]

station = Robolink()
robot = station.ItemUserPick("Pick the robot of these targets", ITEM_TYPE_ROBOT)
if not robot.Valid():
    raise SystemExit("No robot was picked.")
for name, joints in TARGETS:
    target = station.AddTarget(name, robot.Parent(), robot)
    target.setAsJointTarget()
    target.setJoints(joints)
'''


def _write_robodk(program: Program) -> str:
    """Write a script for RoboDK's Python API that adds a joint target a command: degrees and mm."""
    rows = []
    names = make_distinct(program.name_points(), f"{program.name}_")
    digits = LANGUAGES["robodk"].digits
    for name, values in zip(names, program.rows(digits), strict=True):
        listed = ", ".join(values)
        rows.append(f'    ("{name}", [{listed}]),')
    comments = "\n".join(program.comments)
    return ROBODK.format(comments=comments, rows="\n".join(rows))


LANGUAGES = {
    "robodk": Language("RoboDK's Python", _write_robodk, 9, (1, 12), may_slide=True),
    "urscript": Language("URScript", _write_urscript, 9, (6, 6), radians=True),
    "krl": Language("KRL", _write_krl, 6, (1, 6), may_slide=True, max_name=24),
    # 32 characters with run_ before it
    "rapid": Language("RAPID", _write_rapid, 6, (1, 6), max_name=28),
    "ls": Language("Fanuc's LS", _write_ls, 3, (1, 9), may_slide=True),
}
