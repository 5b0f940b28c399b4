"""Nearly good replies, one after the other, until the time is up; exit code 1 at the first find.

    .venv/bin/python -m tests.fuzz.fuzz_parser --minutes 60

Run it from the root of the repository. It prints how many replies were tried, how many of them stated an
action, and, for a find, the reply and the seed that makes it again.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections import Counter

from tests.fuzz.replies import Case, Generator, complaint

from webgym.agent.formats import parse_reply
from webgym.agent.parser import ParseError

SLOW_SECONDS = 2.0
"""No reply of this size takes as long, on any machine, to a parser that is linear."""


def attempt(case: Case) -> tuple[str, str]:
    """(what was found, what is wrong with it)."""
    try:
        found = parse_reply(
            case.text, case.mode, case.prompt_format, screen=case.screen, thinking=case.thinking
        )
    except Exception as error:  # any at all is a find
        return "raised", f"{type(error).__name__}: {error}"
    return found.kind if isinstance(found, ParseError) else "action", complaint(case, found)


def main() -> int:
    """Until the time is up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=1.0, help="how long")
    parser.add_argument("--seed", type=int, default=0, help="of the first reply; the next ones count up")
    options = parser.parse_args()
    end = time.monotonic() + 60 * options.minutes
    found: Counter[str] = Counter()
    slowest = 0.0
    for seed in itertools.count(options.seed):
        if time.monotonic() >= end:
            break
        case = Generator(seed).case()
        started = time.perf_counter()
        name, wrong = attempt(case)
        slowest = max(slowest, time.perf_counter() - started)
        if not wrong and slowest > SLOW_SECONDS:
            wrong = f"it took {slowest:.1f} s"
        found[name] += 1
        if wrong:
            print(f"find at seed {seed}: {wrong}\n{case}")
            return 1
    told = ", ".join(f"{count} {name}" for name, count in found.most_common())
    print(f"{found.total()} replies tried, no find; the slowest took {1000 * slowest:.0f} ms ({told})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
