"""Did the website keep the agent out? (paper §3.4: anti-bot measures that it could not get away from)

These are the rules; where they see nothing, the rubric judge asks a model. They know the pages that the
common guards put in the way, by address, title, words and status. Only how an attempt ended counts: a
challenge that the agent left behind is none. A mistake of the agent, a missing page, a slow page, a fault of
the server and an empty result are not blocking, nor is an article about robots.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from webgym.core.observation import Observation
from webgym.core.text import fold
from webgym.core.verdict import Judgement

REFUSALS: Final = frozenset({401, 403, 405, 407, 429, 503})
"""HTTP statuses with which challenge pages are served. None of them alone is blocking."""

PERSISTENT: Final = 2
"""A bare 403 or 429 counts as blocking from this many looks in a row."""

SHORT_CHARS: Final = 1_500
"""A challenge page says little; a longer text with a challenge's words is about something else."""


class Guard(NamedTuple):
    """A maker of challenge pages and how they are known.

    Attributes:
        name: for the reason.
        address: part of a URL that only its challenges have; empty if there is none.
        titles: whole titles of its pages, folded.
        words: phrases on its pages, folded.
    """

    name: str
    address: str = ""
    titles: tuple[str, ...] = ()
    words: tuple[str, ...] = ()


GUARDS: Final = (
    Guard(
        "Cloudflare",
        r"/cdn-cgi/(?:challenge-platform|l/chk_)|[?&]__cf_chl_",
        ("just a moment...", "attention required! | cloudflare", "please wait... | cloudflare"),
        (
            "checking if the site connection is secure",
            "needs to review the security of your connection",
            "checking your browser before accessing",
            "verify you are human by completing the action below",
            "performance & security by cloudflare",
            "cloudflare ray id",
            "enable javascript and cookies to continue",
            "you have been blocked",
        ),
    ),
    Guard(
        "DataDome",
        r"//(?:geo|ct|interstitial)\.captcha-delivery\.com/",
        (),
        ("please enable js and disable any ad blocker", "slide right to complete the puzzle", "datadome"),
    ),
    Guard(
        "PerimeterX (HUMAN)",
        r"//captcha\.px-c(?:loud|dn)\.net/",
        ("access to this page has been denied", "access to this page has been denied."),
        (
            "press & hold to confirm you are",
            "press and hold to confirm you are",
            "we think you are using automation",
        ),
    ),
    Guard(
        "Akamai",
        r"//errors\.edgesuite\.net/",
        ("access denied",),
        ("you don't have permission to access", "errors.edgesuite.net"),
    ),
    Guard(
        "Google",
        r"//(?:www\.)?google\.[a-z.]+/sorry/",
        (),
        ("detected unusual traffic from your computer network", "about this page our systems have detected"),
    ),
    Guard(
        "Imperva",
        r"/_incapsula_resource",
        ("pardon our interruption",),
        ("incapsula incident id", "made us think you were a bot", "request unsuccessful. incapsula"),
    ),
    Guard(
        "AWS WAF",
        r"//[\w.-]+\.token\.awswaf\.com/",
        ("human verification",),
        ("let's confirm you are human",),
    ),
    Guard(
        "hCaptcha",
        r"//(?:newassets\.)?hcaptcha\.com/captcha/",
        ("one more step",),
        ("one more step please complete",),
    ),
    Guard("Kasada", r"/ips\.js\?kp_", (), ()),
)
"""The guards that websites hire, by what anybody can see of their pages."""

WORDS: Final = (
    "verify you are human",
    "verify that you are human",
    "verifying you are human",
    "confirm you are human",
    "confirm that you are human",
    "are you human",
    "checking your browser",
    "are you a robot",
    "i'm not a robot",
    "i am not a robot",
    "you are not a robot",
    "you're not a robot",
    "unusual traffic",
    "automated traffic",
    "automated access",
    "suspicious activity",
    "complete the captcha",
    "complete the security check",
    "solve the captcha",
    "solve this captcha",
    "enter the characters you see",
    "access to this page has been denied",
    "access denied",
    "access has been blocked",
    "request blocked",
    "too many requests",
)
"""What any challenge page may say."""


def find_block(observations: Sequence[Observation]) -> Judgement:
    """Whether the attempt ended on a page that keeps robots out.

    Args:
        observations: everything that was seen, in order.
    """
    if not observations:
        return Judgement(False, "nothing was seen")
    last = len(observations) - 1
    if reason := challenge(observations[last]):
        return Judgement(True, f"the last page is a challenge: {reason}", (last,))
    tail = observations[-PERSISTENT:]
    if len(tail) == PERSISTENT and all(seen.status in (403, 429) for seen in tail):
        return Judgement(True, f"the website went on answering {tail[-1].status}", (last - 1, last))
    return Judgement(False, "the last page is no challenge")


def challenge(observation: Observation) -> str:
    """What makes this look a challenge page, in a few words; empty if it is none.

    One sign is enough where the server refused; a page that came with status 200 needs an address that only
    challenges have, or two signs and little else on it.
    """
    title = fold(observation.title)
    seen = f"{title} {fold(observation.text or '')}"
    refused = observation.status in REFUSALS
    signs: list[str] = []
    for guard in GUARDS:
        if guard.address and re.search(guard.address, observation.url, re.IGNORECASE):
            return f"its address is one of {guard.name}'s"
        if title in guard.titles:
            signs.append(f'the title "{observation.title}" is one of {guard.name}\'s')
        signs += [f'"{words}", as {guard.name} puts it' for words in guard.words if words in seen]
    signs += [f'"{words}"' for words in WORDS if words in seen]
    is_short = len(seen) <= SHORT_CHARS
    return signs[0] if signs and (refused or (len(signs) > 1 and is_short)) else ""
