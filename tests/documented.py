"""Blocks and commands of README and docs, for tests that run them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
SHELL = ("sh", "bash", "console")
_BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)


def blocks_of(page: Path, *kinds: str) -> Iterator[tuple[int, str]]:
    """The line and text of a page's blocks of these languages."""
    text = page.read_text()
    for match in _BLOCK.finditer(text):
        if match[2] in kinds:
            code = "\n".join(line.removeprefix(match[1]) for line in match[3].splitlines())
            yield text.count("\n", 0, match.start()) + 1, code


def calls(code: str) -> Iterator[list[str]]:
    """The commands of a block of shell, as words."""
    for line in code.replace("\\\n", " ").splitlines():
        words = shlex.shlex(line.removeprefix("$ "), posix=True, punctuation_chars="|&;<>()")
        words.whitespace_split = True
        call: list[str] = []
        for word in [*words, ";"]:
            if word and set(word) <= set("|&;<>()"):
                if call:
                    yield call
                call = []
            elif call or "=" not in word:  # not a variable that is set for the command
                call.append(word)


@cache
def commands_of(page: Path) -> list[list[str]]:
    """A page's commands, as words; the program is named without its folder."""
    found = [call for _, code in blocks_of(page, *SHELL) for call in calls(code)]
    return [[name.rpartition("/")[2], *words] for name, *words in found]


def documented(command: str) -> list[str]:
    """The words behind ``webgym``, ``python -m MODULE`` or the like, of a command that a page has.

    A test that takes a command from here runs it, with what makes it small added, in place of
    ``test_docs_shell.py``, which looks for the calls of this function.
    """
    held = [words for page in PAGES for words in commands_of(page) if " ".join(words) == command]
    assert held, f"no page has the command {command}"
    name, *words = held[0]
    return words[2 if words[:1] == ["-m"] else 1 if name == "python" else 0 :]
