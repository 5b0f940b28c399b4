"""Whether the task's own website blocked the agent, persistently (paper §3.4).

A blocked attempt has no reward, so a failed attempt must not pass for a blocked one. Only the task's own
website counts: its registrable domain, and the website that its start page redirected to. A challenge on
another host, such as a search engine's, does not. An attempt was blocked if the website

- refused at least :data:`PERSISTENT` requests (observations of the same page do not count: waiting at a
  challenge proves nothing);
- refused a page that it should have shown: its front page or, if it had shown pages before, one of those that
  the agent opened again by its address, so that an agent cannot be "blocked" by addresses of its own
  invention;
- showed nothing after that, and, if the agent answered, showed nothing at all;
- had not been hammered: pages that it had shown, opened :data:`HAMMERING` times in a row by their addresses.

The environment finds out before the first action whether a website refuses (:mod:`webgym.rollout.arrival`);
this is for what websites refuse later.

:func:`challenge` recognises the pages of common bot-protection services by address, title, words and status.
A mistake of the agent, a missing page, a slow page, a server error and an empty result are not refusals, nor
is an article about robots or a form with a CAPTCHA in it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Final, TypeAlias
from urllib.parse import urlsplit

import msgspec

from webgym.core.action import LeftClick, Navigate, Type
from webgym.core.observation import Observation
from webgym.core.task import Task
from webgym.core.text import fold
from webgym.core.trajectory import Episode, Step
from webgym.core.verdict import Judgement
from webgym.core.websites import host_or_text, site_or_text

REFUSALS: Final = frozenset({403, 405, 429, 503})
"""HTTP statuses that challenge pages are served with. 401 and 407 are not among them: they ask for a
login."""

BARE_REFUSALS: Final = frozenset({403, 429})
"""HTTP statuses that are a refusal whatever the page says."""

PERSISTENT: Final = 2
"""Fewest refused requests of a blocked attempt: a single one may be temporary, or concern one page only."""

HAMMERING: Final = 4
"""Fewest openings in a row of pages that had been shown, after which a refusal is the agent's doing."""

SHORT_CHARS: Final = 1_500
"""Longest challenge page, characters; a longer text with a challenge's words is about something else."""


class Guard(msgspec.Struct, frozen=True):
    """A bot-protection service, and how its challenge pages are recognised.

    Attributes:
        name: of the service, for the reason.
        address: regular expression of a part of a URL that only its challenges have; empty if there is none.
        titles: whole titles of its pages, folded.
        words: phrases on its pages, folded.
    """

    name: str
    address: str = ""
    titles: tuple[str, ...] = ()
    words: tuple[str, ...] = ()


class _Data(msgspec.Struct, frozen=True):
    words: tuple[str, ...]
    guards: tuple[Guard, ...]


_DATA: Final = msgspec.toml.decode(files("webgym.judge").joinpath("guards.toml").read_bytes(), type=_Data)
GUARDS: Final = _DATA.guards
"""Common bot-protection services."""
WORDS: Final = _DATA.words
"""Phrases of challenge pages of any service, folded."""

FORM_WORDS: Final = re.compile(
    r"\b(?:password|e-?mail|username|user name|first name|last name|phone|message|sign up|sign in|log in|"
    r"log ?in|register|create (?:an )?account|subscribe|newsletter|contact us)\b"
)
"""Words of ordinary forms: a page with several of them is more than a challenge."""

FIELD_ROLES: Final = frozenset({"textbox", "searchbox", "combobox", "listbox", "spinbutton", "checkbox"})
"""Roles of form fields."""

CHALLENGE_SITES: Final = frozenset(
    {"awswaf.com", "captcha-delivery.com", "edgesuite.net", "hcaptcha.com", "perfdrive.com", "px-cdn.net"}
    | {"px-cloud.net"}
)
"""Websites that serve nothing but challenges; a page there is a refusal by the website that was requested."""

SIMILARITY: Final = 0.8
"""Pages that share at least this fraction of their words count as the same page."""


_Address: TypeAlias = tuple[str, str, str]
"""Host without ``www.``, path and query of a page."""


@dataclass(frozen=True)
class _SiteObservation:
    """An observation of the task's own website.

    Attributes:
        index: of the observation.
        refusal: why it counts as a refusal; empty if it does not.
        is_let_in: whether it shows content of the website. A blank page and a server error are neither
            content nor a refusal.
        is_request: whether the agent requested the page with its last action.
        is_opened: whether it did so by opening an address. The address of a submitted form says little.
        is_front: whether it is the front page.
        addresses: the requested address and the one that is shown.
    """

    index: int
    refusal: str
    is_let_in: bool
    is_request: bool
    is_opened: bool
    is_front: bool
    addresses: frozenset[_Address]


NOT_BLOCKED: Final = Judgement(False, "the attempt succeeded")


def find_block(task: Task, episode: Episode, *, suspect_last: bool = False) -> Judgement:
    """Whether the task's own website blocked the agent, by the rules of this module.

    Args:
        task: the task, which names its website.
        episode: the recorded steps.
        suspect_last: count the last observation of the website, and those that resemble it, as refusals even
            though no rule recognises them. An attempt that is not blocked even then cannot be, so no model
            has to be asked.

    Returns:
        The judgement; its steps are the indices of the refused requests.
    """
    observations = list(_site_observations(task, episode, suspect_last))
    let_in = [observation for observation in observations if observation.is_let_in]
    if let_in and episode.answer is not None:
        return Judgement(False, f"the task's website let the agent in at step {let_in[0].index + 1}")
    since = let_in[-1].index if let_in else -1
    refused = [
        observation
        for observation in observations
        if observation.refusal and observation.is_request and observation.index > since
    ]
    if not refused:
        return Judgement(False, "the task's website refused nothing at the end")
    if _is_hammered(let_in):
        return Judgement(False, "the task's website refused after the agent had hammered it")
    if len(refused) < PERSISTENT:
        return Judgement(False, "the task's website refused a single request, which is not persistent")
    shown_addresses = frozenset[_Address]().union(*(observation.addresses for observation in let_in))
    if not any(
        observation.is_opened and observation.addresses & shown_addresses if let_in else observation.is_front
        for observation in refused
    ):
        page = "a page that it had shown before" if let_in else "its front page"
        return Judgement(False, f"the task's website was not asked again for {page}")
    when = f"after step {since + 1}" if let_in else "from the first page on"
    return Judgement(
        True,
        f"the task's website refused every request {when} ({len(refused)}): {refused[-1].refusal}",
        tuple(observation.index for observation in refused),
    )


def _is_hammered(let_in: Sequence[_SiteObservation]) -> bool:
    """Whether the last pages that were shown had been shown before and were opened again and again."""
    in_a_row, shown = 0, frozenset[_Address]()
    for observation in let_in:
        is_again = observation.is_opened and observation.addresses & shown
        in_a_row = in_a_row + 1 if is_again else 0
        shown |= observation.addresses
    return in_a_row >= HAMMERING


def blocking_host(website: str, episode: Episode, blocked: Judgement) -> str:
    """The host that blocked the agent: the host of the last refused request.

    Args:
        website: the task's website.
        episode: the recorded steps.
        blocked: what :func:`find_block` returned.

    Returns:
        The host, as from :func:`webgym.core.websites.host_of`; the task's own host if the challenge was
        served by a bot-protection service's host, or if the judgement names no step.
    """
    observations = episode.observations
    url = (
        observations[blocked.steps[-1]].url
        if blocked.steps and blocked.steps[-1] < len(observations)
        else website
    )
    return host_or_text(website if site_or_text(url) in CHALLENGE_SITES else url)


def _site_observations(task: Task, episode: Episode, suspect_last: bool) -> Iterator[_SiteObservation]:
    """The observations of the task's website or of the one that its start page redirected to, in order."""
    observations = episode.observations
    actions = (step.action for step in episode.steps)
    requested = [task.website, *(action.url if isinstance(action, Navigate) else "" for action in actions)]
    sites: list[str] = []
    for observation, url in zip(observations, requested, strict=False):
        site = site_or_text(observation.url)
        if site in CHALLENGE_SITES:
            site = site_or_text(url) if url else sites[-1]
        sites.append(site)
    own = {site_or_text(task.website), *sites[:1]}
    indices = [index for index, site in enumerate(sites) if site in own]
    suspect = (
        observations[indices[-1]]
        if indices and suspect_last and _is_short(observations[indices[-1]])
        else None
    )
    for index in indices:
        observation = observations[index]
        refusal = refusal_of(observation)
        if not refusal and suspect is not None and _is_similar(observation, suspect):
            refusal = "a page that may be a challenge"
        urls = [url for url in (observation.url, requested[index]) if url and site_or_text(url) in own]
        yield _SiteObservation(
            index,
            refusal,
            is_let_in=not refusal and _has_content(observation),
            is_request=index == 0 or _is_request(episode.steps[index - 1], observation),
            is_opened=bool(requested[index]),
            is_front=any(_address(url)[1:] == ("/", "") for url in urls),
            addresses=frozenset(_address(url) for url in urls),
        )


def _address(url: str) -> _Address:
    try:
        parts = urlsplit(url if "://" in url else f"https://{url}")
        return (parts.hostname or "").removeprefix("www."), parts.path or "/", parts.query
    except ValueError:  # an agent may open anything
        return "", url, ""


def _is_request(step: Step, after: Observation) -> bool:
    """Whether a step requested the page that followed. A page that reloads by itself is no request."""
    if any(notice.kind == "navigation_failed" for notice in after.notices):
        return False
    if isinstance(step.action, Navigate):
        return True
    is_elsewhere = _address(after.url)[:2] != _address(step.observation.url)[:2]
    return is_elsewhere and isinstance(step.action, LeftClick | Type)


def refusal_of(observation: Observation) -> str:
    """Why a page is a website's refusal; empty if it is none."""
    if reason := challenge(observation):
        return reason
    return f"status {observation.status}" if observation.status in BARE_REFUSALS else ""


def _has_content(observation: Observation) -> bool:
    if observation.status is not None and observation.status >= 500:
        return False
    return bool((observation.text or "").strip() or (observation.text is None and observation.title.strip()))


def _is_short(observation: Observation) -> bool:
    return len(fold(f"{observation.title} {observation.text or ''}")) <= SHORT_CHARS


def _is_similar(one: Observation, other: Observation) -> bool:
    """Whether two observations are the same page except for numbers, as challenges at any address are."""
    if one.screenshot == other.screenshot:
        return True
    if one.status != other.status or fold(one.title) != fold(other.title):
        return False
    words, others = (
        {word for word in fold(observation.text or "").split() if not any(char.isdigit() for char in word)}
        for observation in (one, other)
    )
    return len(words & others) >= SIMILARITY * len(words | others)


def challenge(observation: Observation) -> str:
    """What identifies this observation as a challenge page, in a few words; empty if it is not one.

    One sign is enough where the HTTP status is a refusal. A page with another status needs an address that
    only challenges have, or two signs, a short text, and no form that asks for something else.
    """
    title = fold(observation.title)
    text = f"{title} {fold(observation.text or '')}"
    signs: list[str] = []
    for guard in GUARDS:
        if guard.address and re.search(guard.address, observation.url, re.IGNORECASE):
            return f"its address is one of {guard.name}'s"
        if title in guard.titles:
            signs.append(f'the title "{observation.title}" is one of {guard.name}\'s')
        signs += [f'"{words}", as {guard.name} puts it' for words in guard.words if words in text]
    is_refused = observation.status in REFUSALS
    if not is_refused and (not _is_short(observation) or _has_form(observation)):
        return ""
    signs += [f'"{words}"' for words in WORDS if words in text]
    return signs[0] if signs and (is_refused or len(signs) > 1) else ""


def _has_form(observation: Observation) -> bool:
    """Whether a page has an ordinary form: at least two fields, or two of :data:`FORM_WORDS`."""
    fields = sum(element.role in FIELD_ROLES for element in observation.elements or ())
    words = {match[0] for match in FORM_WORDS.finditer(fold(observation.text or ""))}
    return fields > 1 or len(words) > 1
