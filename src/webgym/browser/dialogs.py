"""The dialogs that pages open: ``alert``, ``confirm``, ``prompt``, and the question before a page is left.

A page stands still until its dialog is answered, and with it all pages that share its process: they answer no
command. An ``alert`` is closed at once. A question is accepted at once too, or, for an agent that can answer
it, stays open until the next action; meanwhile every command fails with :class:`DialogOpen`.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress

from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import DialogOpening
from webgym.browser.notices import Notices
from webgym.core.errors import BrowserError

DIALOGS_PER_ACTION = 20
"""Most dialogs that are answered within one action; then the script that opens them is terminated."""

_NO_DIALOGS = "window.alert = window.confirm = window.prompt = () => undefined"
"""Suppresses further dialogs, as browsers offer to when a page opens one dialog after the other."""

_QUOTED_LENGTH = 300
"""Characters of a dialog's message that a notice quotes."""


class DialogOpen(BrowserError):
    """The page waits for the answer to a dialog."""

    code = "browser_dialog_open"


class Dialogs:
    """The dialogs of an episode, whichever of its pages opens them.

    Args:
        notices: where they are reported.
    """

    def __init__(self, notices: Notices) -> None:
        self.stay_open = False
        """Whether a question stays open until the next action."""
        self._notices = notices
        self._open: tuple[Session, DialogOpening] | None = None
        self._count = 0
        self._interrupted: asyncio.Timeout | None = None
        """The work that ends when a question stays open."""

    @property
    def is_open(self) -> bool:
        """Whether a question waits for its answer."""
        return self._open is not None

    def begin_action(self) -> None:
        """Start an action, which may cause ``DIALOGS_PER_ACTION`` of them."""
        self._count = 0

    def on_opening(self, session: Session, event: DialogOpening) -> None:
        """Handle a dialog that a page has opened."""
        self._count += 1
        if self._count > DIALOGS_PER_ACTION:
            session.send("Runtime.terminateExecution")
            if self._count == DIALOGS_PER_ACTION + 1:
                self._notices.add("dialog", "the page would not stop opening dialogs; it may open no more")
        elif self.stay_open and event.type != "alert" and self._open is None:
            self._open = session, event
            waits = f"{_named(event)} is open, and the page waits"
            usual = f"before any other action it is {_usual(event)}"
            self._notices.add("dialog", f"{waits}: answer_dialog answers it; {usual}")
            session.connection.paused = DialogOpen(waits)
            if self._interrupted is not None:
                self._interrupted.reschedule(0.0)
            return
        else:
            self._notices.add("dialog", f"{_named(event)}: {_usual(event)}")
        _answer(session, event)
        if self._count > DIALOGS_PER_ACTION:
            session.send("Runtime.evaluate", {"expression": _NO_DIALOGS})

    def answer(self, *, accept: bool, text: str | None) -> None:
        """Answer the open question.

        Args:
            accept: whether to press OK rather than Cancel.
            text: what to enter into a prompt; ``None`` for what stands in it.
        """
        assert self._open is not None
        (session, event), self._open = self._open, None
        session.connection.paused = None
        _answer(session, event, accept=accept, text=text)

    @asynccontextmanager
    async def interrupting(self) -> AsyncIterator[None]:
        """End the block once a question stays open."""
        try:
            async with asyncio.timeout(None) as self._interrupted:
                yield
        except (DialogOpen, TimeoutError):
            if self._open is None:
                raise
        finally:
            self._interrupted = None

    def cancel(self) -> None:
        """End of an episode: cancel the open question, and accept those of the next one."""
        self.stay_open = False
        if self._open is not None:
            with suppress(BrowserError):  # the browser is gone
                self.answer(accept=False, text=None)

    @contextmanager
    def accepting(self) -> Iterator[None]:
        """Accept the open question, with a notice, and every other one during the block."""
        if self._open is not None:
            self._notices.add("dialog", f"{_named(self._open[1])}: {_usual(self._open[1])}")
            self.answer(accept=True, text=None)
        stay_open, self.stay_open = self.stay_open, False
        try:
            yield
        finally:
            self.stay_open = stay_open


def _answer(session: Session, event: DialogOpening, *, accept: bool = True, text: str | None = None) -> None:
    entered = event.default_prompt if text is None else text
    session.send("Page.handleJavaScriptDialog", {"accept": accept, "promptText": entered})


def _named(event: DialogOpening) -> str:
    if event.type == "beforeunload":
        return "the question whether to leave the page and lose what was entered"
    return f'{event.type} "{event.message[:_QUOTED_LENGTH]}"'


def _usual(event: DialogOpening) -> str:
    """The usual answer to a dialog, in words."""
    return f'answered "{event.default_prompt[:_QUOTED_LENGTH]}"' if event.type == "prompt" else "accepted"
