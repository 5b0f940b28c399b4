"""What an agent observes: the screenshot's name, and what a picture does not show."""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from webgym.core.action import Mode

NoticeKind: TypeAlias = Literal[
    "navigation_failed",  # DNS, TLS, refused, reset, deadline: with the browser's own message
    "download_refused",
    "action_failed",
    "browser",  # what the browser itself says: the bubble of an invalid field, a tooltip
    "dialog",  # alert, confirm, prompt, beforeunload: what it said, how it was answered
    "popup",  # a window was opened, and is in front, or was closed
    "reloaded",  # going back loaded a page again that its scripts had changed
    "still_loading",  # what was still under way when the wait for a quiet page ended
    "crashed",  # the renderer died and was brought back
    "reply_unreadable",  # the agent's last reply held no action
    "shortened",  # something was too long to be observed in full
    "changed",  # the page changed between the picture and the action, where it landed
    "no_effect",  # nothing on the page reacted to a click or a scroll
    "limited",  # our own limits refused connections of the page, parts of which may be missing
    "unchanged",  # the screen is the same as before the action
]


class Notice(msgspec.Struct, frozen=True):
    """An event that the next observation must report."""

    kind: NoticeKind
    text: str


FaultKind: TypeAlias = Literal["connection", "status", "part", "renderer", "route"]


class Fault(msgspec.Struct, frozen=True, omit_defaults=True):
    """Something that failed, and who asked for it, which decides who caused the end of an attempt. Agents do
    not see it. What the egress policy or its limits refuse is none.

    Attributes:
        kind: ``connection``: a document of the tab could not be opened, or broke off. ``status``: its server
            failed (5xx). ``part``: the same of another request of a page to its own website. ``renderer``:
            the process that showed the page was lost, and what its scripts had done with it. ``route``: an
            upstream proxy failed, for a document or a part of it.
        url: what was asked for; of a renderer, the page that it showed.
        why: for people.
        is_typed: whether it was asked for by the address of a ``navigate`` action, and not by the page itself
            (a link, a form, a script); of a renderer, whether such an address opened the page. The address
            that opens a session's first page is its owner's, and not typed.
        error: of a connection, Chromium's name of the error, such as ``ERR_NAME_NOT_RESOLVED``; empty if
            there is none.
    """

    kind: FaultKind
    url: str
    why: str
    is_typed: bool = False
    error: str = ""


class Probed(msgspec.Struct, frozen=True, omit_defaults=True):
    """What came of asking for a page from outside the session.

    Attributes:
        problem: why the website gave no answer; empty if it gave one, or if a limit of ours refused the
            probe.
        status: HTTP status of the answer, redirects not followed; ``None`` without one.
        is_route: whether the problem is that an upstream proxy failed, and not the website.
    """

    problem: str = ""
    status: int | None = None
    is_route: bool = False


class Element(msgspec.Struct, frozen=True, omit_defaults=True):
    """An interactive element that is visible in the viewport and not covered.

    Attributes:
        number: its mark; stable while the element stays in the document.
        role: ARIA role, explicit or implied by the tag (``link``, ``button``, ``textbox``, ``combobox``,
            ``checkbox``, ``radio``, ``option``, ``tab``, ...).
        name: accessible name: label, text, placeholder or title, white space folded; its first 200
            characters.
        box: ``(x, y, width, height)`` of its visible part, CSS pixels of the viewport.
        value: current value of a form control, or of a component of such a role; ``"true"``/``"false"`` for a
            checkbox or radio.
        href: absolute URL of a link.
    """

    number: int
    role: str
    name: str
    box: tuple[float, float, float, float]
    value: str | None = None
    href: str | None = None


def scaled(viewport: tuple[int, int], scale: float) -> tuple[int, int]:
    """The size of a picture of a viewport, pixels."""
    width, height = viewport
    return max(1, round(width * scale)), max(1, round(height * scale))


class Observation(msgspec.Struct, frozen=True, omit_defaults=True):
    """The state of the page at one moment. The picture itself is sent and stored separately, by its name.

    Attributes:
        screenshot: name of the picture, the SHA-256 hex digest of its lossless encoding. Equal names
            mean equal pictures.
        url: URL of the main frame.
        title: title of the document.
        status: HTTP status of the main document; ``None`` where there was no HTTP response.
        viewport: ``(width, height)`` in CSS pixels.
        scroll: ``(offset, extent)``: how far the page is scrolled down, and how tall it is, CSS pixels.
        mode: whether marks are drawn on the picture.
        capture_scale: pixels of the picture for each CSS pixel.
        settled: why the wait for a quiet page ended (``quiet``, ``deadline``, ...).
        notices: what happened since the last observation.
        faults: what failed since then. Agents do not see it.
        text: the text that is visible in the viewport, line by line; ``None`` if not requested. Words that
            are clipped, covered, transparent or in the colour of their background are left out; "…" stands
            for them where the rest of a line is visible. The content of editable fields is not part of it.
        fields: the content of the editable fields in view, one string per field; empty if the text was not
            requested. An agent may have typed it, so it proves nothing about the website.
        cuts: the lines of the whole document of which a part is never visible, wherever the page is
            scrolled, as ``(whole, shown)``; empty if not requested.
        elements: the interactive elements; ``None`` if not requested (always there in marks mode).
        has_login: whether a form for a name or a password is in view, by the fields' types.
        bytes: sent and received since the last observation, by host.
        limited: number of connections that our own limits refused since then, by host. The observation is
            suspect: parts of the page may be missing that the website would have given.
        crowded: of these, the ones that were refused because of other sessions' connections alone.
        milliseconds: wall time per operation (``execute``, ``navigate``, ``settle``, ``screenshot``,
            ``metadata``), and how long the step waited in the server's queues: to act (``queued``) and to be
            observed (``queued_screenshot``).
        route: the upstream proxy by which the page came, or ``direct``; empty if there are none.
    """

    screenshot: str
    url: str
    title: str
    viewport: tuple[int, int]
    status: int | None = None
    scroll: tuple[float, float] = (0.0, 0.0)
    mode: Mode = "coordinates"
    capture_scale: float = 1.0
    settled: str = ""
    notices: tuple[Notice, ...] = ()
    faults: tuple[Fault, ...] = ()
    text: str | None = None
    fields: tuple[str, ...] = ()
    cuts: tuple[tuple[str, str], ...] = ()
    elements: tuple[Element, ...] | None = None
    has_login: bool = False
    bytes: dict[str, int] = {}
    limited: dict[str, int] = {}
    crowded: dict[str, int] = {}
    milliseconds: dict[str, float] = {}
    route: str = ""

    def seconds(self, *operations: str) -> float:
        """Total wall time of these operations, seconds.

        Args:
            operations: their names in :attr:`milliseconds`; one that was not measured counts as 0.
        """
        return sum(self.milliseconds.get(operation, 0.0) for operation in operations) / 1000

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height of the picture, pixels."""
        return scaled(self.viewport, self.capture_scale)

    @property
    def own_seconds(self) -> float:
        """Total wall time of all operations, without waiting in queues, seconds."""
        return self.seconds(*(self.milliseconds.keys() - {"queued", "queued_screenshot"}))
