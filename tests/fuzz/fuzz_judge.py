"""Judge replies and answers of known meaning, one after the other; exit code 1 at the first find.

    .venv/bin/python -m tests.fuzz.fuzz_judge --minutes 60

Run it from the root of the repository. It prints how many inputs were tried, by kind, and, for a find, the
input and the seed that makes it again.
"""

from __future__ import annotations

import sys

from tests.fuzz.judgements import Case, Generator
from tests.fuzz.searching import search


def attempt(seed: int) -> tuple[str, str, Case]:
    """(the kind of the input, what is wrong with how it was read, the input)."""
    case = Generator(seed).case()
    return case.kind, "it was read wrongly" if case.is_wrong else "", case


if __name__ == "__main__":
    sys.exit(search(__doc__, "inputs", attempt))
