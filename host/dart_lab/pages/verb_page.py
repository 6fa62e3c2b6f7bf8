"""The reference of the verbs, generated from their click definitions."""

from __future__ import annotations

import inspect
import re

import click

from dart_hal.cli.main import cli, group_verbs

VERBS_HEAD = """# Verbs

Every verb of the command `dart-hal`, with its options, as `dart-hal VERB --help` prints them.
With `--json` a verb prints one JSON object on standard output; notices go to standard error.
Generated from the program (`dart-hal wire --write`).

| exit status | meaning |
|---:|---|
| 0 | success |
| 1 | negative answer |
| 2 | input that cannot be used |
| 130 | Ctrl-C |
"""
MARKUP = re.compile(r"([|*_$<\\`])")


def render_verbs() -> str:
    """Return the Markdown page of all verbs, in the groups of ``dart-hal --help``."""
    top = click.Context(cli, info_name="dart-hal")
    groups = group_verbs()
    contents = ["| group | verb | what it does |", "|---|---|---|"]
    for group, verbs in groups.items():
        contents += [f"| {group} | [`{name}`](#{anchor(f'dart-hal {name}')}) | {plain(text)} |"
                     for name, text in verbs.items()]
    sections = (part for verbs in groups.values() for name in verbs for part in _command(name, top))
    return "\n".join([VERBS_HEAD, *contents, "", *sections])


def anchor(title: str) -> str:
    """Return the anchor of a heading, as GitHub and the handbook make it."""
    return title.lower().replace(" ", "-")


def plain(text: str) -> str:
    """Escape Markdown in a text and put it on one line."""
    return MARKUP.sub(r"\\\1", " ".join(text.split()))


def _command(name: str, parent: click.Context) -> list[str]:
    """Return the sections of a verb and of its own commands."""
    group = parent.command
    assert isinstance(group, click.Group)
    command = group.get_command(parent, name)
    assert command is not None
    here = click.Context(command, info_name=name, parent=parent)
    level = "##" if parent.parent is None else "###"
    out = [f"{level} {here.command_path}\n", *_help(command), _usage(command, here),
           *_options(here)]
    for sub in command.list_commands(here) if isinstance(command, click.Group) else ():
        out += _command(sub, here)
    return out


def _help(command: click.Command) -> list[str]:
    # click marks paragraphs that it must not wrap with a backspace character.
    paragraphs = inspect.cleandoc(command.help or "").split("\n\n")
    return [plain(p.replace("\b", "")) + "\n" for p in paragraphs if p.strip()]


def _usage(command: click.Command, here: click.Context) -> str:
    pieces = " ".join(p for p in command.collect_usage_pieces(here) if p)
    return f"```text\n{here.command_path} {pieces}\n```\n"


def _options(here: click.Context) -> list[str]:
    records = [p.get_help_record(here) for p in here.command.params
               if isinstance(p, click.Option)]
    # A vertical bar would end the cell of a Markdown table, also within a code span.
    rows = [f"| `{r[0].replace('|', chr(92) + '|')}` | {plain(r[1])} |"
            for r in records if r is not None]
    return ["| option | meaning |\n|---|---|", *rows, ""] if rows else []
