"""Every limit of a browser slot, with its unit and its reason."""

from __future__ import annotations

import ipaddress
import re
from pathlib import Path
from typing import Literal, TypeAlias
from urllib.parse import quote

import msgspec
from pydantic import Field

from webgym.browser.egress.config import EgressConfig
from webgym.core.action import Mode
from webgym.core.task import Attachment, check_attachments
from webgym.settings import Settings

_TEXT = r"[^\x00-\x1f\x7f;\ud800-\udfff]"
_COOKIE = {
    "name": re.compile(r"(?!__(secure|host|http)-)[^\x00-\x20\x7f-\xa0;=\ud800-\udfff]+", re.IGNORECASE),
    "value": re.compile(rf"(?! ){_TEXT}*(?<! )"),
    "domain": re.compile(r"\.?[\w-]+(\.[\w-]+)*\.?|\[[\da-f:.]+\]", re.IGNORECASE | re.ASCII),
    "path": re.compile(rf"/{_TEXT}*"),
}
"""How each part of a cookie is written. Names with these prefixes are for cookies that only HTTPS may set."""

_COOKIE_BYTES = 4096
_COOKIE_PATH_BYTES = 1024
_NUMBER = re.compile(r"\d+|0x[\da-f]*", re.IGNORECASE)
"""The last label of a host that Chromium takes for an address."""

_SAID_LENGTH = 100

SandboxSetting: TypeAlias = Literal["auto", "on", "off"]


class Cookie(msgspec.Struct, frozen=True, omit_defaults=True):
    """A cookie that a session starts with.

    Attributes:
        domain: host that it is sent to; a leading dot includes subdomains.

    Raises:
        ValueError: no browser takes such a cookie (RFC 6265, and Chromium's limits).
    """

    name: str
    value: str
    domain: str
    path: str = "/"

    def __post_init__(self) -> None:
        for part, pattern in _COOKIE.items():
            if not pattern.fullmatch(getattr(self, part)):
                raise ValueError(f"invalid {part} of a cookie: {getattr(self, part)[:_SAID_LENGTH]!r}")
        if (
            len((self.name + self.value).encode()) > _COOKIE_BYTES
            or len(quote(self.path)) > _COOKIE_PATH_BYTES
        ):
            raise ValueError(f"the cookie {self.name[:_SAID_LENGTH]!r} is too large")
        host = self.domain.strip(".[]")
        if _NUMBER.fullmatch(host.rpartition(".")[2]) or self.domain.startswith("["):
            ipaddress.ip_address(host)


class PageOptions(msgspec.Struct, frozen=True, omit_defaults=True):
    """What an episode's page is like.

    Attributes:
        mode: ``marks`` numbers the interactive elements in the picture.
        viewport: ``(width, height)``, CSS pixels; also the picture's size.
        text: whether observations carry the visible text.
        cuts: whether they carry the lines that are cut off, for checks of websites.
        elements: whether observations carry the interactive elements (always in marks mode).
        cookies: set before the first page is opened.
        files: what can be chosen where a page asks for a file.
        jpeg_quality: 1 to 100 for pictures as JPEG, a third of the bytes and a quarter less CPU; ``None``
            for PNG, which loses nothing: equal names of pictures mean equal pixels then.
    """

    mode: Mode = "coordinates"
    viewport: tuple[int, int] = (1280, 768)
    text: bool = False
    cuts: bool = False
    elements: bool = False
    cookies: tuple[Cookie, ...] = ()
    files: tuple[Attachment, ...] = ()
    jpeg_quality: int | None = None

    def __post_init__(self) -> None:
        check_attachments(self.files)


class BrowserConfig(Settings):
    """How a slot's browser is started, how long it may take, and when it is replaced."""

    executable: Path | None = None
    """The Chromium to run; by default the first that is found."""

    egress: EgressConfig = Field(default_factory=EgressConfig)
    """What pages may connect to."""

    sandbox: SandboxSetting = "auto"
    """Chromium's sandbox. ``auto``: on where the machine allows it, off with a warning elsewhere (always as
    root, where Chromium refuses to run with it). ``on``: a browser that cannot have it does not start."""

    temporary_root: Path | None = None
    """Where profiles live; ``None`` is the system's temporary folder."""

    freeze: bool = True
    """Whether a server stops a slot's processes between two calls. A page with an animation or a timer
    burns a quarter of a core while nobody looks; stopped, it uses nothing. It sees a clock that jumped,
    as after a laptop's sleep."""

    # --- deadlines, seconds -----------------------------------------------------------------------

    launch_seconds: float = Field(default=30.0, gt=0)
    """Start to first answer. A launch costs 1 s of CPU, and many slots may launch at once."""

    open_seconds: float = Field(default=20.0, gt=0)
    """A fresh context with its page. Takes 0.1 s on an idle machine."""

    close_seconds: float = Field(default=5.0, gt=0)
    """Throwing a context away. A page that hangs past it costs the slot its browser."""

    kill_seconds: float = Field(default=10.0, gt=0)
    """From SIGKILL until every process of the group must be gone."""

    navigate_seconds: float = Field(default=15.0, gt=0)
    """From asking for a URL to the first byte that replaces the page."""

    execute_seconds: float = Field(default=10.0, gt=0)
    """One input event or script until the page has taken it. A page that takes longer runs a loop,
    which is then ended."""

    screenshot_seconds: float = Field(default=15.0, gt=0)
    """One picture, retries included."""

    screenshot_try_seconds: float = Field(default=3.0, gt=0)
    """One request for a picture. About one in two thousand is never answered, after a navigation; asked
    again, it is. On a busy machine the slowest answers take half a second."""

    screenshot_retry_seconds: float = Field(default=0.05, gt=0)
    """Pause after "Unable to capture screenshot", which Chromium says while a page comes or goes."""

    most_documents: int = Field(default=12, ge=1)
    """Documents that may follow one another in the tab after an action. A page that leads on and on, as one
    that reloads itself, is then held where it is until the next action, so that it can be looked at. Signing
    in somewhere takes five or six."""

    # --- settling -----------------------------------------------------------------------------------

    settle_seconds: float = Field(default=10.0, gt=0)
    """Hard deadline of the wait for a quiet page after an action."""

    tick_seconds: float = Field(default=0.02, gt=0)
    """The pulse in which a page's stillness is counted. A process that is stopped, or starved, does not
    tick; a clock would go on."""

    reaction_seconds: float = Field(default=0.04, gt=0)
    """How long a page that did nothing at all after an action is given to start something."""

    quiet_seconds: float = Field(default=0.1, gt=0)
    """How long a page that did something must show no change to be called quiet."""

    busy_seconds: float = Field(default=1.5, gt=0)
    """How long changes on a loaded page are waited for: a ticking clock never ends. What changed all that
    time is no news from then on."""

    stir_seconds: float = Field(default=4.0, gt=0)
    """The same on a page that was quiet before the action: what an action sets off ends, as an answer that is
    written letter by letter."""

    long_poll_seconds: float = Field(default=4.0, gt=0)
    """A request in flight for longer is taken for a long poll or a stream. The next one to its address is
    not waited for."""

    picture_seconds: float = Field(default=3.0, gt=0)
    """The same for a picture in the viewport."""

    minor_seconds: float = Field(default=1.5, gt=0)
    """The same for what matters less: pictures out of view, frames of other sites and all that they load,
    workers that compute, windows that do not say where they lead. Adverts are slow, and must not hold up
    every step."""

    reply_seconds: float = Field(default=1.0, gt=0)
    """How long a WebSocket or an event stream that was opened or spoken to is given to say something."""

    unread_seconds: float = Field(default=0.5, gt=0)
    """How long the body of an answer to a script is waited for, if its length is known and nothing of it was
    read: pages that only report something never read the answer, and it never ends."""

    load_seconds: float = Field(default=2.0, gt=0)
    """How long after its document is complete a page's load event is waited for."""

    timer_seconds: float = Field(default=1.0, ge=0)
    """Timers that an action set off are waited for if they are due within this time after the page looked
    quiet. Longer ones rather take something back: a confirmation, a tooltip."""

    silent_timer_seconds: float = Field(default=3.0, ge=0)
    """The same on a page that has shown no reaction to the action yet."""

    loading_seconds: float = Field(default=8.0, ge=0)
    """The same, and for requests too, while the page shows that it is loading: a spinner, a skeleton,
    ``aria-busy``, "Loading…", nothing at all."""

    linger_seconds: float = Field(default=2.0, ge=0)
    """How long such a sign is waited for to go when nothing is known to be under way, and for timers that ask
    again and again whether something is there; half as long for what only turns. A sign that stays is taken
    for decoration from then on."""

    trace_kilobytes: int = Field(default=256, gt=0)
    """How much of the browser's trace is kept to see timers in: the last second of a page that animates."""

    trace_seconds: float = Field(default=0.5, gt=0)
    """Deadline for reading the trace. It takes 0.015 s, but 5 s after a process has joined the browser."""

    # --- actions ------------------------------------------------------------------------------------

    scroll_fraction: float = Field(default=0.75, gt=0, le=2)
    """Of the viewport's height, per scroll. A quarter stays in view, so that no line is skipped."""

    typed_keys: int = Field(default=200, ge=1)
    """A text of up to this many characters is typed key by key: there is no telling which fields look at
    every key. A key costs about 1 ms of CPU, as much as inserting a whole text, so a longer one is inserted
    up to its last character, which is a key again. Also the longest text for something that is no field but
    takes keys, such as a board."""

    url_length: int = Field(default=16_384, gt=0)
    """Longest address that is opened, characters: a model that repeats itself writes longer ones."""

    # --- what is observed -----------------------------------------------------------------------------
    # A page may hold hundreds of megabytes of each. What is longer is cut in the page, before it reaches us
    # and every record, and a notice says so.

    title_characters: int = Field(default=1_000, gt=0)
    """Longest title."""

    address_characters: int = Field(default=4_096, gt=0)
    """Longest URL, of the page and of a link. Search and log-in pages use 2,000; data URLs have no limit."""

    text_characters: int = Field(default=100_000, gt=0)
    """Longest text; also all values of fields together, and all values and addresses of elements together.
    A viewport full of small print has 15,000."""

    name_characters: int = Field(default=200, gt=0)
    """Longest name of an element, and of an option in an open list."""

    value_characters: int = Field(default=10_000, gt=0)
    """Longest value of a field: more than an agent writes in one action."""

    observed_elements: int = Field(default=2_000, gt=0)
    """Most elements. Busy viewports have 200; more than fit could not be told apart by their marks."""

    listed_options: int = Field(default=1_000, gt=0)
    """Most options in the open list of a dropdown. The others are chosen by typing their text."""

    document_characters: int = Field(default=1_000_000, gt=0)
    """Longest answer to a reading of a whole document, all its texts together."""

    document_elements: int = Field(default=5_000, gt=0)
    """Most elements in an answer to a reading of a whole document."""

    passed_over: int = Field(default=8, ge=0)
    """Pages that lead on by themselves and that one ``go_back`` goes past."""

    dialogs_per_action: int = Field(default=20, gt=0)
    """Dialogs that are answered within one action; then the script that opens them is ended."""

    notices_per_observation: int = Field(default=12, gt=0)
    """More notices than this are counted, not listed."""

    # --- recycling ----------------------------------------------------------------------------------

    recycle_episodes: int = Field(default=50, gt=0)
    """Episodes that one browser process serves. A fresh one costs 1 s and starts without residue."""

    recycle_seconds: float = Field(default=3600.0, gt=0)
    """Age at which a browser is replaced at the next episode's end."""

    recycle_bytes: int = Field(default=400 * 1024**2, gt=0)
    """Size, renderers left out, at which a browser is replaced at the next episode's end. A fresh one has
    80 MB."""

    # --- memory -------------------------------------------------------------------------------------

    slot_bytes: int = Field(default=2 * 1024**3, gt=0)
    """The most that a slot's processes may take while they run. Heavy pages take half of it; what takes
    more does not stop there."""

    cgroup: Path | None = None
    """A cgroup (version 2) to divide: each browser gets a child of it that limits its memory and processes.

    The limits are twice ``slot_bytes``, and ``slot_tasks``. The cgroup itself must hold no process.
    """

    slot_tasks: int = Field(default=1024, gt=0)
    """Most processes and threads of a browser that has a cgroup. A busy one has 200."""

    reserve_bytes: int = Field(default=512 * 1024**2, ge=0)
    """What the machine must keep free. When it has less, the largest browser makes room."""

    memory_look_seconds: float = Field(default=0.5, gt=0)
    """Between two looks at the sizes of what runs. A page can fill 500 MB in this time."""

    def allowing(self, *rules: str) -> BrowserConfig:
        """The same with these rules in front of the egress policy's own."""
        return self.model_copy(update={"egress": self.egress.allowing(*rules)})
