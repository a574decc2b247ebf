"""Reference pages out of the program itself: the commands' help, the public names' docstrings, the
study file's keys."""

from __future__ import annotations

import inspect
import re
from typing import Any, get_args, get_origin

import click
from pydantic import BaseModel

import modelsel
from modelsel.cli.main import COMMANDS, run_command_line
from modelsel.config.fleet_file import FleetFile
from modelsel.config.study_file import Study
from modelsel.config.study_tables import HeldFrame
from modelsel.robot.kinematics import Robot


def commands() -> str:
    """Every command: what it does, its arguments and options, as `--help` says them."""
    out, context = [], click.Context(run_command_line, info_name="modelsel")
    for name, says in COMMANDS.items():
        command = run_command_line.get_command(context, name)
        assert command is not None
        inner = click.Context(
            command,
            info_name=f"modelsel {name}",
            parent=None,
            terminal_width=110,
            max_content_width=110,
        )
        out += [
            f"## `modelsel {name}` {{ #{name} }}",
            "",
            says,
            "",
            "```text",
            command.get_help(inner).rstrip(),
            "```",
            "",
        ]
    return "\n".join(out)


def _fenced(text: str) -> str:
    """A docstring for Markdown: what is indented is a formula or a table, the rest is prose."""
    return re.sub(r"(?m)^( {4}.*)$", r"    \1", text)


def _sentence(text: str) -> str:
    """The first sentence of a docstring."""
    first = " ".join(text.partition("\n\n")[0].split())
    return re.split(r"(?<=[.)])\s(?=[A-Z])", first)[0]


def _signature(name: str, value: Any) -> str:
    """name(argument: type, …) -> type; an argument a line where it is long."""
    try:
        said = inspect.signature(value)
    except (TypeError, ValueError):
        return name

    def tidy(text: str) -> str:
        text = re.sub(r"Annotated\[(\w+)[^\]]*\]", r"\1", text).replace("'", "")
        return re.sub(
            r"<function <lambda> at 0x[0-9a-f]+>|mappingproxy\(.*\)|\{\'geometric\'.*\}", "…", text
        )

    arguments = [
        tidy(str(p.replace(default=inspect.Parameter.empty) if isinstance(p.default, dict) else p))
        + (" = …" if isinstance(p.default, dict) else "")
        for p in said.parameters.values()
    ]
    gives = (
        ""
        if inspect.isclass(value) or said.return_annotation is inspect.Signature.empty
        else f" -> {tidy(str(said.return_annotation))}"
    )
    one = f"{name}({', '.join(arguments)}){gives}"
    return one if len(one) <= 100 else f"{name}(\n    " + ",\n    ".join(arguments) + f",\n){gives}"


def names() -> str:
    """Every public name of `modelsel`, with its signature and docstring."""
    out = []
    for name in modelsel.__all__:
        value = getattr(modelsel, name)
        home = getattr(value, "__module__", "")
        kind = "class" if inspect.isclass(value) else "function" if callable(value) else "table"
        out += [f"## `{name}` {{ #{name.lower()}-{kind} }}", ""]
        if kind == "table":
            out += [
                f"The {kind} of registered mechanisms, {len(value)} names: see the [catalogue](reference/mechanisms.md).",
                "",
            ]
            continue
        out += [
            "```python",
            _signature(name, value),
            "```",
            "",
            _fenced(inspect.getdoc(value) or ""),
            "",
            f"*{kind} of `{home}`*",
            "",
        ]
        public = (
            [(n, p) for n, p in vars(value).items() if not n.startswith("_")]
            if kind == "class"
            else []
        )
        methods = [
            (n, p)
            for n, p in public
            if inspect.isfunction(p) or isinstance(p, property) or hasattr(p, "func")
        ]
        said = [(n, _sentence(inspect.getdoc(p) or "")) for n, p in methods]
        out += [
            f"- `{n}`: {line}" for n, line in said if line and not issubclass(value, BaseModel)
        ] + [""]
    return "\n".join(out)


def _keys(table: type[BaseModel], head: str = "") -> dict[str, str]:
    out = {}
    for name, field in table.model_fields.items():
        inner = field.annotation
        if set(get_args(inner)) & {Robot, HeldFrame}:  # an object, given from Python alone
            continue
        named = (
            get_origin(inner) is dict
            and isinstance(get_args(inner)[1], type)
            and issubclass(get_args(inner)[1], BaseModel)
        )
        rows = (
            get_args(inner)[0]
            if get_origin(inner) is list
            else get_args(inner)[1]
            if named
            else inner
        )
        if isinstance(rows, type) and issubclass(rows, BaseModel):
            out |= _keys(rows, f"{head}{name}.{'NAME.' if named else ''}")
        else:
            default = (
                "required" if field.is_required() else field.get_default(call_default_factory=True)
            )
            out[f"{head}{field.alias or name}"] = str(default)
    return out


def study_keys() -> dict[str, str]:
    """Every key of the study file as the program reads it, with its default."""
    return _keys(Study)


def fleet_keys() -> dict[str, str]:
    """Every key of the fleet file with its default."""
    return _keys(FleetFile)
