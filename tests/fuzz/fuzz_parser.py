"""Nearly good replies, one after the other, until the time is up; exit code 1 at the first find.

    .venv/bin/python -m tests.fuzz.fuzz_parser --minutes 60

Run it from the root of the repository. It prints how many replies were tried, how many of them stated an
action, and, for a find, the reply and the seed that makes it again.
"""

from __future__ import annotations

import sys

from tests.fuzz.replies import Case, Generator, complaint
from tests.fuzz.searching import search

from webgym.agent.formats import parse_reply
from webgym.agent.parser import ParseError


def attempt(seed: int) -> tuple[str, str, Case]:
    """(what was found, what is wrong with it, the reply)."""
    case = Generator(seed).case()
    try:
        found = parse_reply(
            case.text, case.mode, case.prompt_format, screen=case.screen, thinking=case.thinking
        )
    except Exception as error:  # any at all is a find
        return "raised", f"{type(error).__name__}: {error}", case
    return found.kind if isinstance(found, ParseError) else "action", complaint(case, found), case


if __name__ == "__main__":
    sys.exit(search(__doc__, "replies", attempt))
