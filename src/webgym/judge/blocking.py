"""Did the website keep the agent out? (paper §3.4: anti-bot measures that it could not get away from)

By rules alone: status codes and the words of known challenge pages. A mistake of the agent, a missing
page, a slow page and an empty result are not blocking.
"""

from __future__ import annotations

from collections.abc import Sequence

from webgym.core.observation import Observation
from webgym.core.text import fold
from webgym.core.verdict import Judgement

REFUSALS = frozenset({401, 403, 407, 429, 503})
"""HTTP statuses with which challenge pages are served."""

CHALLENGE_WORDS = (
    "verify you are human",
    "verifying you are human",
    "checking your browser",
    "are you a robot",
    "i'm not a robot",
    "unusual traffic",
    "automated traffic",
    "complete the captcha",
    "solve the captcha",
    "enable javascript and cookies to continue",
    "access to this page has been denied",
    "access denied",
    "request blocked",
)

PERSISTENT = 2
"""A bare 403 or 429 counts as blocking from this many looks in a row."""


def _challenge(observation: Observation) -> str:
    """The words that make this look a challenge page; empty if it is none."""
    seen = fold(f"{observation.title} {observation.text or ''}")
    found = [words for words in CHALLENGE_WORDS if words in seen]
    refused = observation.status in REFUSALS
    # Two such phrases without a refusal: some challenges come with status 200. One alone may be an
    # article about challenges.
    return found[0] if found and (refused or len(found) > 1) else ""


def find_block(observations: Sequence[Observation]) -> Judgement:
    """Whether the attempt ended on a page that keeps robots out.

    Args:
        observations: everything that was seen, in order.
    """
    if not observations:
        return Judgement(False, "nothing was seen")
    last = len(observations) - 1
    words = _challenge(observations[last])
    if words:
        return Judgement(True, f'the last page is a challenge: "{words}"', (last,))
    tail = observations[-PERSISTENT:]
    if len(tail) == PERSISTENT and all(seen.status in (403, 429) for seen in tail):
        return Judgement(True, f"the website went on answering {tail[-1].status}", (last - 1, last))
    return Judgement(False, "the last page is no challenge")
