"""Settings of a browser slot: its limits, with their units and reasons."""

from __future__ import annotations

import ipaddress
import re
from pathlib import Path
from typing import Any, Literal, TypeAlias
from urllib.parse import quote

import msgspec
from pydantic import Field, field_validator

from webgym.browser.egress.config import EgressConfig
from webgym.core.action import Mode
from webgym.core.identity import Identity, check_fields, origin_of
from webgym.core.settings import Settings
from webgym.core.storage import StorageState
from webgym.core.task import Attachment, check_attachments

_TEXT = r"[^\x00-\x1f\x7f;\ud800-\udfff]"
_COOKIE = {
    "name": re.compile(r"(?!__(secure|host|http)-)[^\x00-\x20\x7f-\xa0;=\ud800-\udfff]+", re.IGNORECASE),
    "value": re.compile(rf"(?! ){_TEXT}*(?<! )"),
    "domain": re.compile(r"\.?[\w-]+(\.[\w-]+)*\.?|\[[\da-f:.]+\]", re.IGNORECASE | re.ASCII),
    "path": re.compile(rf"/{_TEXT}*"),
}
"""The syntax of each part of a cookie. The excluded name prefixes are for cookies that only HTTPS may set."""

_COOKIE_BYTES = 4096
_COOKIE_PATH_BYTES = 1024
_NUMBER = re.compile(r"\d+|0x[\da-f]*", re.IGNORECASE)
"""The last label of a host that Chromium parses as an IP address."""

_QUOTED_LENGTH = 100
"""Longest part of an invalid value that an error quotes, characters."""

SandboxSetting: TypeAlias = Literal["auto", "on", "off"]


class Cookie(msgspec.Struct, frozen=True, omit_defaults=True):
    """A cookie that is set before a session's first page.

    Attributes:
        name: name of the cookie.
        value: value of the cookie.
        domain: host that it is sent to; a leading dot includes subdomains.
        path: prefix of the URL paths that it is sent to.

    Raises:
        ValueError: browsers reject such a cookie (RFC 6265, and Chromium's limits).
    """

    name: str
    value: str
    domain: str
    path: str = "/"

    def __post_init__(self) -> None:
        for part, pattern in _COOKIE.items():
            if not pattern.fullmatch(getattr(self, part)):
                raise ValueError(f"invalid {part} of a cookie: {getattr(self, part)[:_QUOTED_LENGTH]!r}")
        if (
            len((self.name + self.value).encode()) > _COOKIE_BYTES
            or len(quote(self.path)) > _COOKIE_PATH_BYTES
        ):
            raise ValueError(f"the cookie {self.name[:_QUOTED_LENGTH]!r} is too large")
        host = self.domain.strip(".[]")
        if _NUMBER.fullmatch(host.rpartition(".")[2]) or self.domain.startswith("["):
            ipaddress.ip_address(host)


CAPTURE_SCALES = (0.25, 1.0)
"""Smallest and largest ``capture_scale``: on a smaller picture nothing can be read."""


class PageOptions(msgspec.Struct, frozen=True, omit_defaults=True):
    """Options of an episode's page.

    Attributes:
        mode: ``marks`` draws the numbers of the interactive elements on the screenshot.
        viewport: ``(width, height)``, CSS pixels; also the screenshot's size, but for ``capture_scale``.
        text: whether observations contain the visible text.
        cuts: whether observations contain the lines that are never fully visible, for checks of websites.
        elements: whether observations contain the interactive elements (always in marks mode).
        cookies: cookies to set before the first page is opened.
        files: files that the agent may upload.
        keep_dialogs: whether a question of a page, such as ``confirm``, stays open until the next action, for
            an agent that can answer it; otherwise it is accepted at once.
        jpeg_quality: 1 to 100 for screenshots as JPEG, a third of the bytes and a quarter less CPU; ``None``
            for PNG, which is lossless, so that equal names of screenshots mean equal pixels.
        capture_scale: 0.25 to 1, pixels of a screenshot for each CSS pixel; ``None`` for the server's own
            (:attr:`BrowserConfig.capture_scale`).
        identity: fields of :class:`~webgym.core.identity.Identity` that differ from ``browser.identity``.
            A browser has one identity, so a slot starts another one for them, which takes a second.
        credentials: HTTP credentials, ``NAME:PASSWORD`` by origin.
        storage: what websites keep in the browser from before, such as that someone is signed in.
        shared: the group whose sessions share parts of pages (:mod:`webgym.browser.shared_parts`); empty for
            none.
    """

    mode: Mode = "coordinates"
    viewport: tuple[int, int] = (1280, 768)
    text: bool = False
    cuts: bool = False
    elements: bool = False
    cookies: tuple[Cookie, ...] = ()
    files: tuple[Attachment, ...] = ()
    keep_dialogs: bool = False
    jpeg_quality: int | None = None
    capture_scale: float | None = None
    identity: dict[str, Any] = {}
    credentials: dict[str, str] = {}
    storage: StorageState = StorageState()
    shared: str = ""

    def __post_init__(self) -> None:
        check_attachments(self.files)
        check_fields(self.identity)
        for origin in self.credentials:
            origin_of(origin)


class BrowserConfig(Settings):
    """How a slot's browser is started, its deadlines and limits, and when it is replaced."""

    executable: Path | None = None
    """The Chromium to run; by default the first one found, headless shells first. ``full``: the first
    that can show windows, with the plug-ins and the ``window.chrome`` of people's browsers; its pictures cost
    twice as much."""

    remote: str | None = None
    """The endpoint of a browser elsewhere: ``wss://HOST/PATH``, or ``http://HOST:9222`` of a Chromium with
    a debugging port; or the environment variable that holds it, such as ``$BROWSER``, as one with a
    password or a query has to be given. What does not hold for such a browser is said at the start."""

    egress: EgressConfig = Field(default_factory=EgressConfig)
    """What pages may connect to."""

    identity: Identity = Field(default_factory=Identity)
    """Who the browser says that it is. Sessions and tasks can differ from it."""

    headed: bool = False
    """Whether the browser shows its windows on the screen, for people: full browsers can, headless shells
    cannot."""

    sandbox: SandboxSetting = "auto"
    """Chromium's sandbox. ``auto``: on where the machine allows it, else off with a warning (always off as
    root, where Chromium refuses to run with it). ``on``: a browser without it does not start."""

    temporary_root: Path | None = None
    """Folder for browser profiles; ``None`` is the system's temporary folder."""

    freeze: bool = True
    """Whether a server stops a slot's processes between two calls. A page with an animation or a timer
    uses a quarter of a core while it is idle; stopped, it uses none. To the page it looks as if the clock had
    jumped, as after a laptop's sleep."""

    # --- deadlines, seconds -----------------------------------------------------------------------

    launch_seconds: float = Field(default=30.0, gt=0)
    """From the start of a browser to its first answer. A launch costs 1 s of CPU, and many slots may launch
    at once."""

    open_seconds: float = Field(default=20.0, gt=0)
    """Creating a context with its page. Takes 0.1 s on an idle machine."""

    navigate_seconds: float = Field(default=15.0, gt=0)
    """From requesting a URL to the first byte that replaces the page."""

    execute_seconds: float = Field(default=10.0, gt=0)
    """Until the page has handled one input event or script. A script of the page that blocks it for longer is
    terminated."""

    screenshot_seconds: float = Field(default=15.0, gt=0)
    """One screenshot, retries included."""

    screenshot_try_seconds: float = Field(default=3.0, gt=0)
    """One request for a screenshot. After a navigation, about one in two thousand is never answered, but a
    second request is; none is while the document has no body. On a busy machine the slowest answers take half
    a second."""

    capture_scale: float = Field(default=1.0, ge=CAPTURE_SCALES[0], le=CAPTURE_SCALES[1])
    """Pixels of a screenshot for each CSS pixel, for models that scale pictures down anyway. Small
    pictures have fewer bytes and cost less CPU. To pages nothing changes, and marks have the same numbers. A
    session may say otherwise."""

    # --- settling -----------------------------------------------------------------------------------

    settle_seconds: float = Field(default=10.0, gt=0)
    """Hard deadline of the wait for a quiet page after an action."""

    quiet_seconds: float = Field(default=0.1, gt=0)
    """How long a page that did something must show no change to be called quiet."""

    busy_seconds: float = Field(default=3.0, gt=0)
    """How long to wait for a loaded page to stop changing: figures that count up take 2 s, and some pages
    never stop, such as one with a clock. Parts that changed all that time are ignored from then on. Half as
    long for animations that may hide a message again, and for scripts that ask for frame after frame and
    change nothing."""

    long_poll_seconds: float = Field(default=4.0, gt=0)
    """A request in flight for longer is not awaited. If the page began it by itself, it is a long poll or a
    stream, and the next one to its address is not awaited at all."""

    minor_seconds: float = Field(default=1.5, gt=0)
    """The same for what matters less: pictures out of view, frames of other sites with everything that they
    load, computing workers, new windows without a URL yet. Advertisements are slow, and must not delay every
    step."""

    reply_seconds: float = Field(default=1.0, gt=0)
    """How long to wait for a message on a WebSocket or an event stream after it was opened or written to;
    twice as long for the answer to a message that an action sent."""

    silent_timer_seconds: float = Field(default=3.0, ge=0)
    """Settling waits for timers that the action caused if they are due within this time, on a page that has
    shown no reaction to the action yet."""

    linger_seconds: float = Field(default=2.0, ge=0)
    """How long to wait for a sign of loading to disappear when nothing is known to be in progress; half as
    long for a sign that only spins. One that was there before the action is not awaited."""

    # --- actions ------------------------------------------------------------------------------------

    url_length: int = Field(default=16_384, gt=0)
    """Longest URL to open, characters: a model that repeats itself writes longer ones."""

    passed_over: int = Field(default=8, ge=0)
    """Most pages that redirect by script and that one ``go_back`` skips."""

    # --- recycling ----------------------------------------------------------------------------------

    recycle_episodes: int = Field(default=50, gt=0)
    """Episodes that one browser process serves. A fresh process costs 1 s and has no leftover state."""

    # --- memory -------------------------------------------------------------------------------------

    slot_bytes: int = Field(default=2 * 1024**3, gt=0)
    """Most memory that a slot's processes may use. Heavy pages use half of it; a page that exceeds it usually
    keeps growing."""

    cgroup: Path | None = None
    """A cgroup (version 2) in which each browser gets a child cgroup that limits its memory and processes.

    The limits are twice ``slot_bytes``, and ``slot_tasks``. The cgroup itself must contain no process.
    """

    slot_tasks: int = Field(default=1024, gt=0)
    """Most processes and threads of a browser that has a cgroup. A busy one has 200."""

    reserve_bytes: int = Field(default=512 * 1024**2, ge=0)
    """Memory that must stay available on the machine. When less is available, the largest browser, or its
    largest renderer, is ended."""

    @field_validator("remote")
    @classmethod
    def _holds_no_secret(cls, value: str | None) -> str | None:
        if value is not None and any(mark in value for mark in "@?"):  # the message must not repeat it
            raise ValueError("put an endpoint with a query or a password into a variable, such as $BROWSER")
        return value

    def allowing(self, *rules: str) -> BrowserConfig:
        """A copy with these rules before the egress policy's own."""
        return self.model_copy(update={"egress": self.egress.allowing(*rules)})
