"""Pieces of sentences: arguments of commands as a person types them into a shell, and counted nouns."""

from __future__ import annotations

import os
import re
import shlex

# What no shell splits at or replaces; a backslash stands in paths of Windows alone.
_PLAIN = re.compile(r"[\w@%+=:,./\\-]+" if os.name == "nt" else r"[\w@%+=:,./-]+")
# What a shell other than that of Windows replaces within double quotes too.
_REPLACED = re.compile(r'["$`!\\]')


def quoted(argument: object) -> str:
    """Return an argument of a printed command, in quotes where a shell would split or replace it."""
    text = str(argument)
    if _PLAIN.fullmatch(text):
        return text
    if os.name != "nt" and _REPLACED.search(text):
        return shlex.quote(text)
    # The shells of Linux, macOS and Windows all know double quotes.
    return f'"{text}"'


def counted(count: int, noun: str) -> str:
    """Write `1 case` or `2 cases`, `1 loss` or `2 losses`."""
    plural = "es" if noun.endswith("s") else "s"
    return f"{count} {noun}{'' if count == 1 else plural}"
