"""Failures have types.

    WebGymError
    ├── UsageError             what the user gave cannot be used; nothing was started
    │   ├── ConfigError        a setting is missing or out of range
    │   ├── TaskFileError      a task file is missing or a record in it is broken
    │   ├── TooFewWebsites     more test tasks are asked for than there are websites
    │   ├── NothingToDraw      a sampler is asked for tasks of a kind that there is none of
    │   └── RunFolderError     the folder is not a run, or not the run that was asked for
    ├── PageError              of a page or an action; the agent is informed and the attempt continues
    │   ├── NavigationFailed   DNS, TLS, refused connection, reset, deadline
    │   │   ├── EgressRefused  refused by the egress policy or its limit on connections to a host
    │   │   ├── SiteRefused    the task's website refuses its start page
    │   │   └── SiteDead       the task's website has no start page to show: SiteNameGone, SiteTls,
    │   │                      SiteNoAnswer, SiteServerError, SiteRegion, SiteParked, SiteRobots
    │   │   └── RouteFailed    an upstream proxy failed
    │   └── ActionFailed       no such element, nothing to go back to
    ├── BrowserError           a browser process failed
    │   ├── BrowserNotFound    no Chromium on this machine
    │   ├── BrowserLaunchFailed
    │   ├── BrowserCrashed     the process or its renderer is gone
    │   │   └── BrowserOutOfMemory   it exceeded its memory limit and was ended
    │   └── BrowserTimeout     no answer within the hard deadline
    ├── ServerError            the browser server, or the connection to it, failed
    │   ├── ServerUnreachable
    │   ├── Unauthorized       the token is invalid or missing
    │   ├── LeaseLost          the session expired, was closed or belongs to a successor
    │   │   └── WorkerLost     the process or machine that held the session is gone
    │   ├── NoCapacity         no slot became free within the longest wait
    │   │   ├── TooManySessions  one client has reached its limit on sessions
    │   │   └── TooManyWaiting   the queue for slots is full
    │   └── ProtocolError      a request or reply that violates the protocol
    ├── SitesError             the offline web, or the connection to it, failed
    ├── LLMError               a model's endpoint failed; agent and judge turn it into an error of their own
    │   ├── LLMUnreachable
    │   ├── LLMTimeout         no complete reply within the deadline
    │   ├── LLMBadReply        an HTTP error, HTML, nothing, an endless stream
    │   ├── LLMUnusable        none of its replies has the requested form
    │   ├── BudgetSpent        the next call could cost more than is left of the budget
    │   └── NotCached          the batch that is to provide this reply has not been imported yet
    ├── CacheError             the cache of model replies cannot be read or written
    ├── PolicyError            the policy, or its endpoint, failed
    │   ├── PolicyUnreachable
    │   ├── PolicyTimeout      no complete reply within the deadline
    │   └── PolicyBadReply     an HTTP error, HTML, nothing, an endless stream
    ├── AttemptOverdue         an attempt, or a step of it, exceeded its time limit
    ├── EpisodeLost            an environment's episode ended without a reward (with ``on_fault="raise"``)
    ├── JudgeError             the judge gave no verdict; never a silent 0 or 1
    ├── TrainingError          training cannot continue; earlier checkpoints are intact
    │   └── PublishError       the policy's server did not load new weights, or replies with other ones
    └── StoreError             the run folder cannot be written or read; the run stops, no record is lost
        ├── StoreFull          no space left on the device
        ├── StoreLocked        another collector writes to this run
        └── StoreCorrupt       a record's checksum does not match

Each class belongs to one boundary and :func:`webgym.core.outcome.outcome_of` turns it into one outcome.
``code``, the class's name in lower case, names it on the wire and in records; ``hint`` says what to do about
it.
"""

from __future__ import annotations

import re
from typing import ClassVar, Final

_WORD: Final = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
"""Where a word begins in the name of a class."""


class WebGymError(Exception):
    """Base of all errors that WebGym raises on purpose.

    Args:
        message: one line, what happened.
        hint: one line, what the reader can do about it; where none is given, the class's own.
    """

    code: ClassVar[str] = "webgym_error"
    usual_hint: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if cls.__module__ == __name__:  # a class elsewhere has its base's code, unless it names its own
            cls.code = _WORD.sub("_", cls.__name__).lower()

    def __init__(self, message: str, *, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint or self.usual_hint

    def __str__(self) -> str:
        return f"{self.message} ({self.hint})" if self.hint else self.message


class UsageError(WebGymError):
    """What the user gave cannot be used."""


class ConfigError(UsageError):
    """A setting is missing or out of range."""


class TaskFileError(UsageError):
    """A task file is missing, or holds no usable record."""


class TooFewWebsites(UsageError):
    """More test tasks are asked for than there are websites to take them from."""


class NothingToDraw(UsageError):
    """A sampler is asked for tasks of a kind that the task set does not contain."""


class RunFolderError(UsageError):
    """A folder is not a run, or not the run that was asked for."""


class PageError(WebGymError):
    """Of a page or an action: the agent is informed, and the attempt continues, unless a probe from outside
    the session confirms that the task's own website is down (:mod:`webgym.rollout.driver`)."""


class NavigationFailed(PageError):
    """A page could not be opened.

    Args:
        url: what was asked for last, redirects followed; empty if nothing was.
        error: Chromium's name of the error of the network, such as ``ERR_NAME_NOT_RESOLVED``; empty if there
            was none.
    """

    def __init__(self, message: str, *, hint: str = "", url: str = "", error: str = "") -> None:
        super().__init__(message, hint=hint)
        self.url = url
        self.error = error.removeprefix("net::") if error.startswith("net::") else ""


class EgressRefused(NavigationFailed):
    """The egress policy, or its limit on new connections to one host, refused the connection."""

    by_policy: ClassVar[str] = "refused by the egress policy"
    """The beginning of the reason, unless it was the limit."""


class RouteFailed(NavigationFailed):
    """An upstream proxy failed: the environment's failure, whatever was asked for and whoever did."""


class SiteRefused(NavigationFailed):
    """The website refuses its start page persistently, before the agent has done anything."""


class SiteDead(NavigationFailed):
    """The website has no start page to show, before the agent has done anything. Another attempt soon would
    find the same."""


class SiteNameGone(SiteDead):
    """Its name does not exist."""


class SiteTls(SiteDead):
    """Its certificate, or its TLS, is refused."""


class SiteNoAnswer(SiteDead):
    """There is no connection, or one that gives no answer."""


class SiteServerError(SiteDead):
    """It answers with a 5xx status."""


class SiteRegion(SiteDead):
    """It answers with 451, or a notice that it does not serve this region."""


class SiteParked(SiteDead):
    """The domain is for sale."""


class SiteRobots(SiteDead):
    """Its robots.txt asks robots not to open the page, and the run respects that."""


class ActionFailed(PageError):
    """An action could not be carried out on this page."""


class BrowserError(WebGymError):
    """A browser process failed."""


class BrowserNotFound(BrowserError):
    """There is no usable Chromium on this machine."""


class BrowserLaunchFailed(BrowserError):
    """A Chromium was found but did not start."""


class BrowserCrashed(BrowserError):
    """The browser process or its renderer is gone."""

    usual_hint = "the session is over; open a new one"


class BrowserOutOfMemory(BrowserCrashed):
    """The browser, or its page, exceeded its memory limit and was ended."""

    usual_hint = "the session is over; open a new one, or allow more with browser.slot_bytes"


class BrowserTimeout(BrowserError):
    """The browser gave no answer within its hard deadline."""

    usual_hint = "the session is over; open a new one"


class ServerError(WebGymError):
    """The browser server, or the connection to it, failed."""


class ServerUnreachable(ServerError):
    """Nothing answers at the server's address."""


class Unauthorized(ServerError):
    """The token is invalid or missing."""


class LeaseLost(ServerError):
    """The session expired, was closed, or its slot belongs to a successor."""


class WorkerLost(LeaseLost):
    """The process or the machine that held the session is gone, and the session with it."""


class NoCapacity(ServerError):
    """No slot became free within the longest wait."""


class TooManySessions(NoCapacity):
    """One client has reached its limit on sessions."""


class TooManyWaiting(NoCapacity):
    """The queue for slots is full; try again later."""

    @classmethod
    def of(cls, count: int) -> TooManyWaiting:
        """The error for a queue of this length."""
        return cls(f"{count:,} callers wait for a slot already", hint="try again later, or start more slots")


class ProtocolError(ServerError):
    """A request or a reply violates the protocol."""


class SitesError(WebGymError):
    """The offline web, or the connection to it, failed."""


class LLMError(WebGymError):
    """A model's endpoint failed. The calling package turns it into a policy's or a judge's error."""


class LLMUnreachable(LLMError):
    """Nothing answers at the endpoint's address."""


class LLMTimeout(LLMError):
    """The endpoint gave no complete reply within its deadline."""


class LLMBadReply(LLMError):
    """The endpoint answered with something that is not a completion."""


class LLMUnusable(LLMError):
    """The model replied, and none of its replies has the requested form.

    Attributes:
        reason: why the last reply was rejected.
        replies: the texts of all replies, oldest first.
    """

    def __init__(
        self, message: str, *, hint: str = "", reason: str = "", replies: tuple[str, ...] = ()
    ) -> None:
        super().__init__(message, hint=hint)
        self.reason = reason
        self.replies = replies


class BudgetSpent(LLMError):
    """The next call could cost more than is left of the budget. It was not made."""

    usual_hint = "paid replies are cached: raise the budget and run again to continue from here"


class NotCached(LLMError):
    """The batch that is to provide this reply has not been imported yet. The request was recorded."""

    usual_hint = "send the batch files, and import the results"


class CacheError(WebGymError):
    """The cache of model replies cannot be read or written."""


class PolicyError(WebGymError):
    """The policy, or its endpoint, failed."""


class PolicyUnreachable(PolicyError):
    """Nothing answers at the policy's address."""


class PolicyTimeout(PolicyError):
    """The policy gave no complete reply within its deadline."""


class PolicyBadReply(PolicyError):
    """The policy's endpoint answered with something that is not a completion."""


class AttemptOverdue(WebGymError):
    """An attempt, or one step of it, exceeded its time limit, for a reason that is not known."""

    usual_hint = "attempt.longest_seconds is the limit"


class EpisodeLost(WebGymError):
    """An episode of an environment ended without a reward: it was blocked, or the environment, the policy or
    the judge failed."""

    usual_hint = "reset and continue; on_fault='nan' gives a reward of NaN instead"


class JudgeError(WebGymError):
    """The judge gave no verdict."""


class TrainingError(WebGymError):
    """Training cannot continue, for example because the loss is NaN. Earlier checkpoints are intact."""


class PublishError(TrainingError):
    """The policy's server did not load new weights, or replies with other ones. No such reply was used."""


class StoreError(WebGymError):
    """A record of the run folder cannot be written or read."""


class StoreFull(StoreError):
    """No space is left on the device."""


class StoreLocked(StoreError):
    """Another collector writes to this run."""


class StoreCorrupt(StoreError):
    """A record's checksum does not match its content."""


def _classes_by_code(cls: type[WebGymError]) -> dict[str, type[WebGymError]]:
    # A class without a code of its own is private to a module, and is sent as its base class.
    classes = {cls.code: cls} if "code" in vars(cls) else {}
    for child in cls.__subclasses__():
        classes |= _classes_by_code(child)
    return classes


def error_from_code(code: str, message: str, hint: str = "") -> WebGymError:
    """The error that ``code`` names, as it was raised on the other side of a connection.

    An unknown code (a newer peer) gives a plain :class:`WebGymError`.
    """
    return _classes_by_code(WebGymError).get(code, WebGymError)(message, hint=hint)
