"""Judge replies and answers of known meaning, one after the other; exit code 1 at the first find.

    .venv/bin/python -m tests.fuzz.fuzz_judge --minutes 60

Run it from the root of the repository. It prints how many inputs were tried, by kind, and, for a find, the
input and the seed that makes it again.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections import Counter

from tests.fuzz.judgements import Generator

SLOW_SECONDS = 2.0
"""No input of this size takes as long, on any machine, to a reader that is linear."""


def main() -> int:
    """Until the time is up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=1.0, help="how long")
    parser.add_argument("--seed", type=int, default=0, help="of the first input; the next ones count up")
    options = parser.parse_args()
    end = time.monotonic() + 60 * options.minutes
    tried: Counter[str] = Counter()
    slowest = 0.0
    for seed in itertools.count(options.seed):
        if time.monotonic() >= end:
            break
        started = time.perf_counter()
        try:
            case = Generator(seed).case()
        except Exception as error:  # any at all is a find
            print(f"find at seed {seed}: {type(error).__name__}: {error}")
            return 1
        slowest = max(slowest, time.perf_counter() - started)
        tried[case.kind] += 1
        if case.is_wrong or slowest > SLOW_SECONDS:
            print(f"find at seed {seed} after {slowest:.1f} s: {case!r}")
            return 1
    told = ", ".join(f"{count} {kind}" for kind, count in tried.most_common())
    print(f"{tried.total()} inputs tried, no find; the slowest took {1000 * slowest:.0f} ms ({told})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
