"""From a task and its past to the request that a policy answers (paper §5, appendix C).

A request is a system message, then the last rounds as (screenshot, reply) pairs, then the current
screenshot. The first user message opens with the task, a list of the actions that are older than the window
with their effects, and the current memory. Every observation is also described in text: the URL, the scroll
position, and events that a picture does not show.

Others wrote most of a user message: the task, the page's title and address, what a dialog said, what the
agent put into its memory. So all of it passes :func:`webgym.core.text.visible`, and so does a reply in the
history, except for the tags of its tool call: no text can open a turn or a picture.

The lengths of requests are estimates that err upwards, so that an endpoint accepts every request that passes.
A request that is too long is trimmed in this order until it fits, and no further:

1. screenshots of the window, oldest first; their text and replies stay;
2. lines of the list of earlier actions, oldest first;
3. rounds of the window, oldest first;
4. entries of the memory as it is shown, oldest first; the memory itself keeps them.

The system message, the task and the current observation with its screenshot always stay. If they alone are
too long, the attempt ends as the policy's error: no request is sent that the endpoint would refuse.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final, TypeAlias

import msgspec

from webgym.agent.compact import COMPACT_FORMATS, action_line, memory_line, progress_line
from webgym.agent.computer_use import to_arguments
from webgym.agent.config import WITH_MEMORY, AgentConfig
from webgym.agent.image_sizing import Size
from webgym.agent.memory import to_json
from webgym.agent.parser import CALL_TAGS, ParsedReply, ParseError, without_thinking
from webgym.agent.profile import Profile, Thinking
from webgym.agent.prompts import system_prompt
from webgym.core.action import GRID, Action
from webgym.core.errors import PolicyError
from webgym.core.observation import Notice, NoticeKind, Observation
from webgym.core.task import Task
from webgym.core.text import visible
from webgym.core.trajectory import ImageRef, Message, Reply, Revision, Step, TextPart

_MESSAGE_TOKENS: Final = 6
"""Tokens that a chat template adds to every message."""

_PIECE = re.compile(
    r"(?P<word>(?<!\w)[A-Z]?[a-z]{1,12}(?!\w))|(?P<letters>[A-Za-z]+)"
    r"|(?P<single> (?=[A-Za-z]))|(?P<space>\s+)|(?P<ascii>[\x00-\x7f])|(?P<other>.)",
    re.DOTALL,
)
_WORD_LETTERS: Final = 5
"""Letters per token of a word. English has more, other languages in Latin script about as many."""

_LETTERS: Final = 1.5
"""Letters per token of other letters: identifiers, capitals, base64; random letters have about 1.7."""

SUMMARY_LINE_MAX_CHARS = 200
"""Longest description of one older action in the list of actions."""


class Cut(msgspec.Struct, frozen=True):
    """How many items are left out of a request, the oldest of each kind first.

    Attributes:
        pictures: screenshots of the window.
        rounds: rounds of the window.
        lines: lines of the list of earlier actions, which then includes the rounds that are left out.
        entries: entries of the memory.
    """

    pictures: int = 0
    rounds: int = 0
    lines: int = 0
    entries: int = 0


Render: TypeAlias = Callable[[Cut], tuple[Message, ...]]


@lru_cache(maxsize=1024)  # instructions and earlier rounds are in every request of an attempt
def text_tokens(text: str) -> int:
    """Estimated number of tokens of a text; rather too many than too few.

    Byte-pair vocabularies differ, so the estimate relies on what they have in common: words count by their
    letters, digits and signs one by one, other scripts by the bytes of each character.
    """
    return sum(_piece_tokens(piece) for piece in _PIECE.finditer(text))


def _piece_tokens(piece: re.Match[str]) -> int:
    length = len(piece[0])
    match piece.lastgroup:
        case "word":
            return math.ceil(length / _WORD_LETTERS)
        case "letters":
            return math.ceil(length / _LETTERS)
        case "single":  # a single space belongs to the word after it
            return 0
        case "space":
            return min(length, 2)
        case "other":
            return max(1, len(piece[0].encode(errors="replace")) - 1)
        case _:
            return 1


def request_tokens(messages: Sequence[Message], profile: Profile) -> int:
    """Estimated number of tokens of a request, pictures included."""
    return sum(
        _MESSAGE_TOKENS + sum(_part_tokens(part, profile) for part in message.content) for message in messages
    )


def _part_tokens(part: TextPart | ImageRef, profile: Profile) -> int:
    if isinstance(part, TextPart):
        return text_tokens(part.text)
    return profile.pictures.tokens((part.width, part.height))


def fit_request(
    render: Render,
    profile: Profile,
    *,
    rounds: int,
    lines: int,
    entries: int,
    most_tokens: int,
    most_images: int | None,
) -> tuple[tuple[Message, ...], Cut]:
    """The longest request that the limits allow, and what was left out of it.

    Args:
        render: builds the request with the given cut.
        profile: the model's profile, for the cost of pictures.
        rounds: number of rounds in the window.
        lines: number of lines in the list of earlier actions.
        entries: number of entries in the memory.
        most_tokens: longest request, in estimated tokens.
        most_images: most pictures in a request; ``None`` for no limit.

    Raises:
        PolicyError: the parts that are never left out are too long.
    """
    excess = 0 if most_images is None else min(rounds, max(0, rounds + 1 - most_images))
    cuts = [Cut(pictures=number) for number in range(excess, rounds + 1)]
    cuts += [Cut(pictures=rounds, lines=number) for number in range(1, lines + 1)]
    cuts += [Cut(rounds, number, lines + number) for number in range(1, rounds + 1)]
    cuts += [Cut(rounds, rounds, lines + rounds, number) for number in range(1, entries + 1)]

    whole = render(cuts[0])
    if request_tokens(whole, profile) <= most_tokens:
        return whole, cuts[0]
    position = bisect_left(cuts, True, key=lambda cut: request_tokens(render(cut), profile) <= most_tokens)
    if position == len(cuts):
        least = request_tokens(render(cuts[-1]), profile)
        message = f"the request is about {least} tokens at its shortest, and {most_tokens} are allowed"
        raise PolicyError(message, hint="raise agent.request_tokens, and the endpoint's context with it")
    return render(cuts[position]), cuts[position]


class Round(msgspec.Struct, frozen=True):
    """A past step with its parsed reply.

    Attributes:
        step: the record, with ``changed`` set.
        parsed: the parsed reply.
    """

    step: Step
    parsed: ParsedReply | ParseError


class AttemptPosition(msgspec.Struct, frozen=True):
    """The current position in an attempt.

    Attributes:
        observation: the current observation.
        index: number of this turn, from 0.
        budget: total number of turns.
        memory: the agent's memory.
        revision: corrections to the last reply's memory.
        progress: the agent's latest statement of progress, which the compact formats repeat.
    """

    observation: Observation
    index: int
    budget: int
    memory: Mapping[str, Any] = {}
    revision: Revision = Revision()
    progress: Mapping[str, Any] = {}


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


_CALL_TAG: Final = re.compile(f"({'|'.join(CALL_TAGS)})")
_NO_REPLY: Final = "(no reply)"
"""Stands for a reply of which nothing is shown: some endpoints refuse a request with an empty message."""


class Request(msgspec.Struct, frozen=True):
    """A request to a policy.

    Attributes:
        messages: the messages, with pictures by name.
        cut: what was left out because the request was too long.
    """

    messages: tuple[Message, ...]
    cut: Cut = Cut()


def build_request(
    task: Task, past: Sequence[Round], now: AttemptPosition, config: AgentConfig, profile: Profile
) -> Request:
    """The request for the next reply.

    Args:
        task: the task; the request states its instruction, website and files only.
        past: all earlier rounds, oldest first.
        now: the current observation and memory.
        config: window, format, limits.
        profile: mode, picture sizes, grid.

    Raises:
        PolicyError: the parts that are never left out are too long.
    """
    rounds = min(config.rounds, len(past))
    messages, cut = fit_request(
        lambda cut: _render(task, past, now, config, profile, cut),
        profile,
        rounds=rounds,
        lines=len(past) - rounds,
        entries=len(now.memory) if config.prompt_format in WITH_MEMORY else 0,
        most_tokens=config.request_tokens or profile.request_tokens,
        most_images=config.max_images or profile.max_images,
    )
    return Request(messages, cut)


def _render(
    task: Task, past: Sequence[Round], now: AttemptPosition, config: AgentConfig, profile: Profile, cut: Cut
) -> tuple[Message, ...]:
    if config.prompt_format in COMPACT_FORMATS:
        return _render_compact(task, past, now, config, profile, cut)
    rounds = min(config.rounds, len(past)) - cut.rounds
    older, window = past[: len(past) - rounds], past[len(past) - rounds :]
    seen = now.observation
    screen = profile.screen(profile.picture_size(seen.picture_size, config.image_max_side))
    messages = [Message("system", (TextPart(system_prompt(config, profile.mode, screen)),))]
    opening = _opening(task, older, now, config, screen, cut)
    before = older[-1] if older else None
    blind = cut.pictures - cut.rounds
    for number, shown in enumerate(window):
        text = opening + _observation_text(shown.step.observation, shown.step.index, now.budget, before)
        picture = None if number < blind else _picture(shown.step.observation, config, profile)
        messages.append(_user(text, picture))
        messages.append(_shown_reply(shown.step.reply, profile))
        opening, before = "", shown
    text = opening + _observation_text(seen, now.index, now.budget, before) + _revision_text(now.revision)
    messages.append(_user(text, _picture(seen, config, profile)))
    return tuple(messages)


def _render_compact(
    task: Task, past: Sequence[Round], now: AttemptPosition, config: AgentConfig, profile: Profile, cut: Cut
) -> tuple[Message, ...]:
    """The request in a compact format: the picture comes first, and the task is in the last message."""
    rounds = min(config.rounds, len(past)) - cut.rounds
    screen = profile.screen(profile.picture_size(now.observation.picture_size, config.image_max_side))
    blind = cut.pictures - cut.rounds
    messages = [Message("system", (TextPart(system_prompt(config, profile.mode, screen)),))]
    for number, shown in enumerate(past[len(past) - rounds :]):
        picture = () if number < blind else (_picture(shown.step.observation, config, profile),)
        messages.append(Message("user", (*picture, TextPart(f"step {shown.step.index + 1} of {now.budget}"))))
        messages.append(_shown_reply(shown.step.reply, profile))
    lines = [f"task {task.instruction}"]
    if config.prompt_format in WITH_MEMORY:
        lines.append(f"memory {memory_line(dict(list(now.memory.items())[cut.entries :]))}".rstrip())
        lines.append(f"progress {progress_line(now.progress)}".rstrip())
    lines.append(_last_line(past[-1] if past else None, screen))
    lines += [f"note {kind}" for kind in _compact_notices(now.observation)]
    lines.append(f"step {now.index + 1} of {now.budget}")
    shown_now = (_picture(now.observation, config, profile), TextPart(visible("\n".join(lines))))
    return (*messages, Message("user", shown_now))


def _last_line(before: Round | None, screen: Size) -> str:
    match before.parsed if before else None:
        case None:
            return "last nothing"
        case ParseError():
            return "last unreadable"
        case ParsedReply(action=action):
            assert before is not None
            effect = "changed" if before.step.changed else "unchanged"
            return f"last {action_line(action, screen)} {effect}"


def _compact_notices(observation: Observation) -> list[str]:
    kinds = {notice.kind for notice in observation.notices} - {"unchanged", "no_effect", "reply_unreadable"}
    return sorted(kinds)


def _shown_reply(reply: Reply, profile: Profile) -> Message:
    text = without_thinking(reply.text, thinking_of(reply, profile))
    parts = (part if part in CALL_TAGS else visible(part) for part in _CALL_TAG.split(text))
    return Message("assistant", (TextPart("".join(parts) or _NO_REPLY),))


def thinking_of(reply: Reply, profile: Profile) -> Thinking:
    """How this reply marks its thinking. If the endpoint separated the thinking, none is open at the
    start."""
    return "tagged" if reply.reasoning or reply.separated else profile.thinking


def picture_names(messages: Sequence[Message]) -> set[str]:
    """The names of all pictures in a request."""
    return {part.screenshot for message in messages for part in message.content if isinstance(part, ImageRef)}


def _picture(observation: Observation, config: AgentConfig, profile: Profile) -> ImageRef:
    width, height = profile.picture_size(observation.picture_size, config.image_max_side)
    return ImageRef(observation.screenshot, width, height, profile.detail)


def _user(text: str, picture: ImageRef | None) -> Message:
    if picture is None:
        text += "\n(The screenshot of this step is left out.)"
    return Message("user", (TextPart(visible(text)), *(() if picture is None else (picture,))))


def _opening(
    task: Task, older: Sequence[Round], now: AttemptPosition, config: AgentConfig, screen: Size, cut: Cut
) -> str:
    parts = [f"Task: {task.instruction}", f"It starts on: {task.website}"]
    if task.files and config.actions == "extended":
        named = ", ".join(f"{_cut(file.name, 200)!r} ({len(file.content)} bytes)" for file in task.files)
        parts.append(f"Its files, for upload: {named}")
    if older:
        lines = [f"(The first {cut.lines} are left out.)"] if cut.lines else []
        lines += [_summary_line(past, screen, SUMMARY_LINE_MAX_CHARS) for past in older[cut.lines :]]
        parts.append("Earlier actions:\n" + "\n".join(lines))
    if config.prompt_format in WITH_MEMORY:
        shown = dict(list(now.memory.items())[cut.entries :])
        left_out = f" (The {cut.entries} oldest entries are kept but left out here.)" if cut.entries else ""
        parts.append(f"Memory so far: {to_json(shown)}{left_out}")
    return "\n\n".join(parts) + "\n\n"


def _summary_line(past: Round, screen: Size, max_chars: int) -> str:
    match past.parsed:
        case ParseError(kind=kind):
            return f"{past.step.index + 1}. Your reply held no action ({kind})."
        case ParsedReply(action=action, description=description):
            sentence = _cut(description, max_chars) or describe(action, screen, max_chars)
            effect = {True: "the page changed", False: "nothing changed", None: "effect unknown"}
            return f"{past.step.index + 1}. {sentence} - {effect[past.step.changed]}."


def describe(action: Action, screen: Size = (GRID, GRID), max_chars: int = 200) -> str:
    """A short text of the action, for people and for lists of actions; at most ``max_chars`` long."""
    arguments = to_arguments(action, screen)
    name = arguments.pop("action")
    arguments_text = ", ".join(f"{key} {value!r}" for key, value in arguments.items())
    return _cut(f"{name} {arguments_text}".strip(), max_chars)


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
    detail = _cut(" ".join(notice.text.split()), 500)
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
    shown = ", ".join(repr(_cut(key, 60)) for key in keys[:8])
    return shown if len(keys) <= 8 else f"{shown} and {len(keys) - 8} more"
