"""Whether the task's own website blocked the agent, persistently (paper §3.4).

A blocked attempt carries no reward, so this must be no way out for one that failed. What counts is the
task's own website, by its registrable domain and wherever the start page led; a challenge on any other host,
such as a search engine's, is met on the way and excuses nothing. An attempt was blocked if the website

- refused at least :data:`PERSISTENT` requests, not looks: waiting at a challenge proves nothing;
- refused a page that it would have to show: its front page or, where it had let the agent in, a page that it
  had shown before and that the agent opened by its address. So no navigation escapes;
- never let the agent in after that, and never at all if the agent answered.

:func:`challenge` knows the pages that the common guards put in the way, by address, title, words and status.
A mistake of the agent, a missing page, a slow page, a fault of the server and an empty result are no
refusals, nor is an article about robots or a form with a CAPTCHA in it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias
from urllib.parse import urlsplit

from webgym.core.action import LeftClick, Navigate, Type
from webgym.core.observation import Observation
from webgym.core.task import Task
from webgym.core.text import fold
from webgym.core.trajectory import Episode, Step
from webgym.core.verdict import Judgement
from webgym.core.websites import host_or_text, site_or_text

REFUSALS: Final = frozenset({403, 405, 429, 503})
"""HTTP statuses with which challenge pages are served; 401 and 407 ask everybody to log in."""

BARE_REFUSALS: Final = frozenset({403, 429})
"""Those that are a refusal whatever the page says."""

PERSISTENT: Final = 2
"""So many requests must be refused: one refusal may be a passing one, or the page's own."""

SHORT_CHARS: Final = 1_500
"""A challenge page says little; a longer text with a challenge's words is about something else."""


class Guard(NamedTuple):
    """A vendor of challenge pages, and how its pages are recognised.

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


FORM_WORDS: Final = re.compile(
    r"\b(?:password|e-?mail|username|user name|first name|last name|phone|message|sign up|sign in|log in|"
    r"log ?in|register|create (?:an )?account|subscribe|newsletter|contact us)\b"
)
"""What pages ask for or offer that are there for something else than the test in them."""

FIELD_ROLES: Final = frozenset({"textbox", "searchbox", "combobox", "listbox", "spinbutton", "checkbox"})
"""What a form consists of."""

CHALLENGE_SITES: Final = frozenset(
    {"awswaf.com", "captcha-delivery.com", "edgesuite.net", "hcaptcha.com", "perfdrive.com", "px-cdn.net"}
    | {"px-cloud.net"}
)
"""Websites that hold nothing but guards' challenges; one there is the refusal of the website asked for."""

ALIKE: Final = 0.8
"""Pages that share this much of their words are the same page at other addresses."""


_Address: TypeAlias = tuple[str, str, str]
"""Of a page: host without ``www.``, path, query."""


@dataclass(frozen=True)
class _Look:
    """A look at the task's own website.

    Attributes:
        index: of the observation.
        refusal: why it counts as a refusal; empty if it is none.
        is_let_in: whether it shows that the website let the agent in. A blank page and a fault of the server
            are neither.
        is_request: whether the page was asked for anew.
        is_opened: whether by its address. Of a form that was sent, the address alone says little.
        is_front: whether it is the front page.
        addresses: what was asked for and what is shown.
    """

    index: int
    refusal: str
    is_let_in: bool
    is_request: bool
    is_opened: bool
    is_front: bool
    addresses: frozenset[_Address]


def find_block(task: Task, episode: Episode, *, suspect_last: bool = False) -> Judgement:
    """Whether the task's own website blocked the agent, by the rules of this module.

    Args:
        task: says which website.
        episode: what happened.
        suspect_last: take the last look at the website, and those that look alike, for refusals though no
            rule knows them. An attempt that is not blocked even so is not, whatever a model says.

    Returns:
        The finding; its steps are the refused requests it rests on.
    """
    looks = list(_own_looks(task, episode, suspect_last))
    shown = [look for look in looks if look.is_let_in]
    if shown and episode.answer is not None:
        return Judgement(False, f"the task's website let the agent in at step {shown[0].index + 1}")
    since = shown[-1].index if shown else -1
    refused = [look for look in looks if look.refusal and look.is_request and look.index > since]
    if not refused:
        return Judgement(False, "the task's website refused nothing at the end")
    if len(refused) < PERSISTENT:
        return Judgement(False, "the task's website refused a single request, which is not persistent")
    known = frozenset[_Address]().union(*(look.addresses for look in shown))
    if not any(look.is_opened and look.addresses & known if shown else look.is_front for look in refused):
        what = "a page that it had shown before" if shown else "its front page"
        return Judgement(False, f"the task's website was not asked again for {what}")
    when = f"after step {since + 1}" if shown else "from the first page on"
    return Judgement(
        True,
        f"the task's website refused every request {when} ({len(refused)}): {refused[-1].refusal}",
        tuple(look.index for look in refused),
    )


def blocking_host(website: str, episode: Episode, blocked: Judgement) -> str:
    """The host that blocked the agent: that of the last request that was refused.

    Args:
        website: of the task.
        episode: what happened.
        blocked: the finding.

    Returns:
        As :func:`webgym.core.websites.host_of`; the task's own host where a guard's host took the place of
        the refusing one, or where the finding names no step.
    """
    seen = episode.observations
    url = seen[blocked.steps[-1]].url if blocked.steps and blocked.steps[-1] < len(seen) else website
    return host_or_text(website if site_or_text(url) in CHALLENGE_SITES else url)


def _own_looks(task: Task, episode: Episode, suspect_last: bool) -> Iterator[_Look]:
    """The looks at the task's website, in order. Where it led at the start is the task's website, too."""
    seen = episode.observations
    asked = [task.website, *(_opened(step) for step in episode.steps)]
    sites: list[str] = []
    for look, url in zip(seen, asked, strict=False):
        site = site_or_text(look.url)
        if site in CHALLENGE_SITES:
            site = site_or_text(url) if url else sites[-1]
        sites.append(site)
    own = {site_or_text(task.website), *sites[:1]}
    indices = [index for index, site in enumerate(sites) if site in own]
    suspect = seen[indices[-1]] if indices and suspect_last and _is_short(seen[indices[-1]]) else None
    for index in indices:
        look = seen[index]
        refusal = _refusal(look)
        if not refusal and suspect is not None and _is_alike(look, suspect):
            refusal = "a page that may be a challenge"
        urls = [url for url in (look.url, asked[index]) if url and site_or_text(url) in own]
        yield _Look(
            index,
            refusal,
            is_let_in=not refusal and _shows_something(look),
            is_request=index == 0 or _is_request(episode.steps[index - 1], look),
            is_opened=bool(asked[index]),
            is_front=any(_address(url)[1:] == ("/", "") for url in urls),
            addresses=frozenset(_address(url) for url in urls),
        )


def _opened(step: Step) -> str:
    """The URL that the agent opened with this step; empty if it did something else."""
    return step.action.url if isinstance(step.action, Navigate) else ""


def _address(url: str) -> _Address:
    try:
        parts = urlsplit(url if "://" in url else f"https://{url}")
        return (parts.hostname or "").removeprefix("www."), parts.path or "/", parts.query
    except ValueError:  # an agent may open anything
        return "", url, ""


def _is_request(step: Step, after: Observation) -> bool:
    """Whether the page after a step was asked for by that step. What a page does by itself is no request."""
    if any(notice.kind == "navigation_failed" for notice in after.notices):
        return False
    if isinstance(step.action, Navigate):
        return True
    is_elsewhere = _address(after.url)[:2] != _address(step.observation.url)[:2]
    return is_elsewhere and isinstance(step.action, LeftClick | Type)


def _refusal(look: Observation) -> str:
    if sign := challenge(look):
        return sign
    return f"status {look.status}" if look.status in BARE_REFUSALS else ""


def _shows_something(look: Observation) -> bool:
    if look.status is not None and look.status >= 500:
        return False
    return bool((look.text or "").strip() or (look.text is None and look.title.strip()))


def _is_short(look: Observation) -> bool:
    return len(fold(f"{look.title} {look.text or ''}")) <= SHORT_CHARS


def _is_alike(one: Observation, other: Observation) -> bool:
    """Whether two looks are the same page but for numbers, as challenges are at whatever address."""
    if one.screenshot == other.screenshot:
        return True
    if one.status != other.status or fold(one.title) != fold(other.title):
        return False
    words, others = (
        {word for word in fold(look.text or "").split() if not any(char.isdigit() for char in word)}
        for look in (one, other)
    )
    return len(words & others) >= ALIKE * len(words | others)


def challenge(observation: Observation) -> str:
    """What makes this look a challenge page, in a few words; empty if it is none.

    One sign is enough where the server refused; a page that came with status 200 needs an address that only
    challenges have, or two signs and little else on it, no form that asks for something else in particular.
    """
    title = fold(observation.title)
    seen = f"{title} {fold(observation.text or '')}"
    signs: list[str] = []
    for guard in GUARDS:
        if guard.address and re.search(guard.address, observation.url, re.IGNORECASE):
            return f"its address is one of {guard.name}'s"
        if title in guard.titles:
            signs.append(f'the title "{observation.title}" is one of {guard.name}\'s')
        signs += [f'"{words}", as {guard.name} puts it' for words in guard.words if words in seen]
    is_refused = observation.status in REFUSALS
    if not is_refused and (not _is_short(observation) or _has_form(observation)):
        return ""
    signs += [f'"{words}"' for words in WORDS if words in seen]
    return signs[0] if signs and (is_refused or len(signs) > 1) else ""


def _has_form(observation: Observation) -> bool:
    """Whether a page asks for more than the test: two fields or more, or the words of such a form."""
    fields = sum(element.role in FIELD_ROLES for element in observation.elements or ())
    words = {match[0] for match in FORM_WORDS.finditer(fold(observation.text or ""))}
    return fields > 1 or len(words) > 1
