"""From a task and its past to the request that a policy answers (paper §5, appendix C).

A request is a system message, then the last rounds as (screenshot, reply) pairs, then the current
screenshot. The first user message opens with the task, the actions that are older than the window, in
words and with their effect, and the current memory. Every observation is told in words as well: the
address, how far the page is scrolled, and whatever happened that a picture does not show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from webgym.agent.config import AgentConfig
from webgym.agent.images import fitted_size
from webgym.agent.memory import Revision, to_json
from webgym.agent.parser import ParsedReply, ParseError, without_thinking_or_all
from webgym.agent.prompts import system_prompt
from webgym.agent.wire import to_arguments
from webgym.core.action import Action
from webgym.core.observation import Notice, NoticeKind, Observation
from webgym.core.task import Task
from webgym.core.trajectory import ImageRef, Message, Step, TextPart


class Round(msgspec.Struct, frozen=True):
    """A past step as the context needs it.

    Attributes:
        step: the record, with ``changed`` filled in.
        parsed: what its reply meant.
    """

    step: Step
    parsed: ParsedReply | ParseError


class Now(msgspec.Struct, frozen=True):
    """Where the attempt stands.

    Attributes:
        observation: what is to be acted on.
        index: number of this turn, from 0.
        budget: turns in all.
        memory: what has been remembered so far.
        revision: how the last reply's memory had to be mended.
    """

    observation: Observation
    index: int
    budget: int
    memory: Mapping[str, Any] = {}
    revision: Revision = Revision()


_NOTICES: dict[NoticeKind, str] = {
    "navigation_failed": "The page could not be opened",
    "download_refused": "A download was refused; files cannot be downloaded",
    "action_failed": "The last action could not be carried out",
    "dialog": "The page showed a dialog",
    "popup": "The page wanted to open another window",
    "still_loading": "The page is still loading",
    "crashed": "The page crashed and was loaded again",
    "reply_unreadable": "Your last reply held no action, so nothing was done",
    "unchanged": "The screen is the same as before your last action",
}


def build_messages(task: Task, past: Sequence[Round], now: Now, config: AgentConfig) -> tuple[Message, ...]:
    """The request for the next reply. Pictures stand in it by name.

    Args:
        task: what the agent is to do; only its instruction and website are told.
        past: all earlier rounds, oldest first.
        now: the current observation and memory.
        config: window, mode, format.
    """
    window = past[len(past) - min(config.rounds, len(past)) :]
    older = past[: len(past) - len(window)]
    messages = [Message("system", (TextPart(system_prompt(config)),))]
    opening = _opening(task, older, now, config)
    before = older[-1] if older else None
    for shown in window:
        text = _observation_text(shown.step.observation, shown.step.index, now.budget, before)
        messages.append(_user(opening + text, shown.step.observation, config))
        reply = without_thinking_or_all(shown.step.reply.text)
        messages.append(Message("assistant", (TextPart(reply),)))
        opening, before = "", shown
    text = _observation_text(now.observation, now.index, now.budget, before) + _revision_text(now.revision)
    messages.append(_user(opening + text, now.observation, config))
    return tuple(messages)


def picture_names(messages: Sequence[Message]) -> set[str]:
    """The names of all pictures in a request."""
    return {part.screenshot for message in messages for part in message.content if isinstance(part, ImageRef)}


def _user(text: str, observation: Observation, config: AgentConfig) -> Message:
    width, height = fitted_size(observation.viewport, config.image_max_side)
    return Message("user", (TextPart(text), ImageRef(observation.screenshot, width, height)))


def _opening(task: Task, older: Sequence[Round], now: Now, config: AgentConfig) -> str:
    parts = [f"Task: {task.instruction}", f"It starts on: {task.website}"]
    if older:
        lines = [_summary_line(past, config.summary_line_max_chars) for past in older]
        parts.append("Earlier actions:\n" + "\n".join(lines))
    if config.prompt_format == "memory":
        parts.append(f"Memory so far: {to_json(now.memory)}")
    return "\n\n".join(parts) + "\n\n"


def _summary_line(past: Round, max_chars: int) -> str:
    match past.parsed:
        case ParseError(kind=kind):
            return f"{past.step.index + 1}. Your reply held no action ({kind})."
        case ParsedReply(action=action, description=description):
            said = _cut(description, max_chars) or describe(action, max_chars)
            effect = {True: "the page changed", False: "nothing changed", None: "effect unknown"}
            return f"{past.step.index + 1}. {said} - {effect[past.step.changed]}."


def describe(action: Action, max_chars: int = 200) -> str:
    """The action in a few words, for people and for lists of actions."""
    arguments = to_arguments(action)
    name = arguments.pop("action")
    told = ", ".join(f"{key} {value!r}" for key, value in arguments.items())
    return _cut(f"{name} {told}".strip(), max_chars)


def _cut(text: str, max_chars: int) -> str:
    return text if len(text) <= max_chars else text[: max_chars - 1] + "…"


def _observation_text(observation: Observation, index: int, budget: int, before: Round | None) -> str:
    offset, extent = observation.scroll
    place = f", scrolled to {offset:.0f} of {extent:.0f} px" if extent > observation.viewport[1] else ""
    lines = [
        f"Step {index + 1} of {budget}. Page: {_cut(observation.title, 200)!r} at "
        f"{_cut(observation.url, 500)}{place}."
    ]
    if observation.status is not None and observation.status >= 400:
        lines.append(f"The website answered with the HTTP error {observation.status}.")
    lines += [_notice_text(notice) for notice in _notices(observation, before)]
    return "\n".join(lines)


def _notices(observation: Observation, before: Round | None) -> list[Notice]:
    """What the observation says, and what follows from the step before if it does not say it."""
    notices = list(observation.notices)
    kinds = {notice.kind for notice in notices}
    if before is None or kinds & {"reply_unreadable", "unchanged"}:
        return notices
    if isinstance(before.parsed, ParseError):
        notices.append(Notice("reply_unreadable", before.parsed.message))
    elif before.step.changed is False:
        notices.append(Notice("unchanged", ""))
    return notices


def _notice_text(notice: Notice) -> str:
    said = _cut(" ".join(notice.text.split()), 500)
    opening = _NOTICES[notice.kind]
    return f"Note: {opening}: {said}" if said else f"Note: {opening}."


def _revision_text(revision: Revision) -> str:
    if not revision:
        return ""
    told = []
    if revision.dropped:
        told.append(f"left out {_keys(revision.dropped)}, which was kept")
    if revision.rewritten:
        told.append(f"changed {_keys(revision.rewritten)}; the old value was kept and the new one added")
    if revision.refused:
        told.append(f"is full, so {_keys(revision.refused)} was not taken in")
    return "\nNote: The memory is append-only. Yours " + "; it ".join(told) + "."


def _keys(keys: Sequence[str]) -> str:
    shown = ", ".join(repr(_cut(key, 60)) for key in keys[:8])
    return shown if len(keys) <= 8 else f"{shown} and {len(keys) - 8} more"
