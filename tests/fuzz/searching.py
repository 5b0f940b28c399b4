"""A search for inputs that are read wrongly."""

from __future__ import annotations

import argparse
import itertools
import time
from collections import Counter
from collections.abc import Callable

SLOW_SECONDS = 2.0
"""No input of this size takes as long, on any machine, to a reader that is linear."""


def search(about: str | None, what: str, attempt: Callable[[int], tuple[str, str, object]]) -> int:
    """Try one input after the other until the time is up; 1 at the first find.

    Args:
        about: the command's description.
        what: is tried, as a plural.
        attempt: makes and reads the input of a seed; its kind, what is wrong, or nothing, and the input.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawTextHelpFormatter)
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
            kind, wrong, case = attempt(seed)
        except Exception as error:  # any at all is a find
            kind, wrong, case = "raised", f"{type(error).__name__}: {error}", None
        slowest = max(slowest, time.perf_counter() - started)
        tried[kind] += 1
        if wrong or slowest > SLOW_SECONDS:
            print(f"find at seed {seed}, the slowest took {slowest:.1f} s: {wrong}\n{case}")
            return 1
    told = ", ".join(f"{count} {kind}" for kind, count in tried.most_common())
    print(f"{tried.total()} {what} tried, no find; the slowest took {1000 * slowest:.0f} ms ({told})")
    return 0
