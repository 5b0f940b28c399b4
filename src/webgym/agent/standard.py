"""The standard formats (paper §5, appendix C): sections in words, and a tool call.

A request is a system message, then the last rounds as (screenshot, reply) pairs, then the current
screenshot. The first user message opens with the task, a list of the actions that are older than the window
with their effects, and the current memory. Every observation is also described in text: the URL, the scroll
position, and events that a picture does not show.

Others wrote most of a user message: the task, the page's title and address, what a dialog said, what the
agent put into its memory. So all of it passes :func:`webgym.core.text.visible`, and so does a reply in the
history, except for the tags of its tool call: no text can open a turn or a picture.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, get_args

from webgym.agent.config import AgentConfig
from webgym.agent.context import Cut, Round, cut_short, describe, picture_of, shown_reply
from webgym.agent.formats import Format, Turn
from webgym.agent.image_sizing import Size
from webgym.agent.memory import to_json
from webgym.agent.parser import ParsedReply, ParseError, read_sections
from webgym.agent.profile import Thinking
from webgym.agent.prompts import system_prompt, write_sections
from webgym.core.action import Action, Mode, Space
from webgym.core.observation import Notice, NoticeKind, Observation
from webgym.core.task import Task
from webgym.core.text import visible
from webgym.core.trajectory import ImageRef, Message, Revision, TextPart

SUMMARY_LINE_MAX_CHARS = 200
"""Longest description of one older action in the list of actions."""


_NOTICES: dict[NoticeKind, str] = {
    "navigation_failed": "The page could not be opened",
    "download_refused": "A download was refused; files cannot be downloaded",
    "action_failed": "The last action could not be carried out",
    "browser": "The browser says",
    "dialog": "The page showed a dialog",
    "popup": "Windows were opened or closed",
    "reloaded": "Going back did not find the page as it was",
    "still_loading": "The page is still loading",
    "crashed": "The page crashed",
    "reply_unreadable": "Your last reply held no action, so nothing was done",
    "shortened": "The page has more than is told of it; this was cut",
    "changed": "The page changed before the last action landed",
    "no_effect": "The last action had no effect",
    "limited": "Parts of the page may be missing, because the browser limits its connections",
    "unchanged": "The screen is the same as before your last action",
}


@dataclass(frozen=True)
class StandardFormat(Format):
    """Sections in words, and a tool call; the request shows the window, the list of actions, the memory."""

    has_memory: bool
    adds_memory = False
    has_end = True
    spaces = get_args(Space)

    def messages(self, turn: Turn, cut: Cut) -> tuple[Message, ...]:
        """A turn for each round of the window, after a list of earlier actions and the memory."""
        task, past, now, config, profile = turn
        rounds = min(config.rounds, len(past)) - cut.rounds
        older, window = past[: len(past) - rounds], past[len(past) - rounds :]
        seen = now.observation
        screen = profile.screen(profile.picture_size(seen.picture_size, config.image_max_side))
        messages = [Message("system", (TextPart(system_prompt(config, profile.mode, screen)),))]
        opening = _opening(task, older, config, screen, cut)
        if self.has_memory:
            shown_memory = to_json(dict(list(now.memory.items())[cut.entries :]))
            note = f" (The {cut.entries} oldest entries are kept but left out here.)" if cut.entries else ""
            opening += f"Memory so far: {shown_memory}{note}\n\n"
        before = older[-1] if older else None
        blind = cut.pictures - cut.rounds
        for number, shown in enumerate(window):
            text = opening + _observation_text(shown.step.observation, shown.step.index, now.budget, before)
            picture = None if number < blind else picture_of(shown.step.observation, config, profile)
            messages.append(_user(text, picture))
            messages.append(shown_reply(shown.step.reply, profile))
            opening, before = "", shown
        text = opening + _observation_text(seen, now.index, now.budget, before) + _revision_text(now.revision)
        messages.append(_user(text, picture_of(seen, config, profile)))
        return tuple(messages)

    def read(self, text: str, mode: Mode, screen: Size, thinking: Thinking, space: Space) -> ParsedReply:
        """By the rules of :mod:`webgym.agent.parser`."""
        return read_sections(text, mode, screen, thinking, space, has_memory=self.has_memory)

    def write(
        self,
        action: Action,
        *,
        description: str,
        memory: Mapping[str, Any],
        progress: Mapping[str, Any],
        intention: str,
        screen: Size,
    ) -> str:
        """Headings with their sections, and the call."""
        stated = dict[str, Any](Memory=memory, Progress=progress, Intention=intention)
        stated = stated if self.has_memory else {}
        return write_sections(action, description=description, stated=stated, screen=screen)


MEMORY: Final = StandardFormat(has_memory=True)
OFFICIAL: Final = StandardFormat(has_memory=False)


def _user(text: str, picture: ImageRef | None) -> Message:
    if picture is None:
        text += "\n(The screenshot of this step is left out.)"
    return Message("user", (TextPart(visible(text)), *(() if picture is None else (picture,))))


def _opening(task: Task, older: Sequence[Round], config: AgentConfig, screen: Size, cut: Cut) -> str:
    parts = [f"Task: {task.instruction}", f"It starts on: {task.website}"]
    if task.files and config.actions == "extended":
        named = ", ".join(f"{cut_short(file.name, 200)!r} ({len(file.content)} bytes)" for file in task.files)
        parts.append(f"Its files, for upload: {named}")
    if older:
        lines = [f"(The first {cut.lines} are left out.)"] if cut.lines else []
        lines += [_summary_line(past, screen, SUMMARY_LINE_MAX_CHARS) for past in older[cut.lines :]]
        parts.append("Earlier actions:\n" + "\n".join(lines))
    return "\n\n".join(parts) + "\n\n"


def _summary_line(past: Round, screen: Size, max_chars: int) -> str:
    match past.parsed:
        case ParseError(kind=kind):
            return f"{past.step.index + 1}. Your reply held no action ({kind})."
        case ParsedReply(action=action, description=description):
            sentence = cut_short(description, max_chars) or describe(action, screen, max_chars)
            effect = {True: "the page changed", False: "nothing changed", None: "effect unknown"}
            return f"{past.step.index + 1}. {sentence} - {effect[past.step.changed]}."


def _observation_text(observation: Observation, index: int, budget: int, before: Round | None) -> str:
    offset, extent = observation.scroll
    place = f", scrolled to {offset:.0f} of {extent:.0f} px" if extent > observation.viewport[1] else ""
    lines = [
        f"Step {index + 1} of {budget}. Page: {cut_short(observation.title, 200)!r} at "
        f"{cut_short(observation.url, 500)}{place}."
    ]
    if observation.status is not None and observation.status >= 400:
        lines.append(f"The website answered with the HTTP error {observation.status}.")
    lines += [_notice_text(notice) for notice in _notices(observation, before)]
    return "\n".join(lines)


def _notices(observation: Observation, before: Round | None) -> list[Notice]:
    """The observation's notices, and those that follow from the previous step if they are missing."""
    notices = list(observation.notices)
    kinds = {notice.kind for notice in notices}
    if before is None or kinds & {"reply_unreadable", "unchanged", "no_effect"}:
        return notices
    if isinstance(before.parsed, ParseError):
        notices.append(Notice("reply_unreadable", before.parsed.message))
    elif before.step.changed is False:
        notices.append(Notice("unchanged", ""))
    return notices


def _notice_text(notice: Notice) -> str:
    detail = cut_short(" ".join(notice.text.split()), 500)
    opening = _NOTICES[notice.kind]
    return f"Note: {opening}: {detail}" if detail else f"Note: {opening}."


def _revision_text(revision: Revision) -> str:
    if not revision:
        return ""
    corrections = []
    if revision.dropped:
        corrections.append(f"left out {_keys(revision.dropped)}, which was kept")
    if revision.rewritten:
        keys = _keys(revision.rewritten)
        corrections.append(f"changed {keys}; the old value was kept and the new one added")
    if revision.refused:
        corrections.append(f"is full, so {_keys(revision.refused)} was not taken in")
    return "\nNote: The memory is append-only. Yours " + "; it ".join(corrections) + "."


def _keys(keys: Sequence[str]) -> str:
    shown = ", ".join(repr(cut_short(key, 60)) for key in keys[:8])
    return shown if len(keys) <= 8 else f"{shown} and {len(keys) - 8} more"
