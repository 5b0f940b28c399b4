"""What a request is made of: the rounds of an attempt, its current position, and how long it may become.

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

from webgym.agent.computer_use import to_arguments
from webgym.agent.config import AgentConfig
from webgym.agent.image_sizing import Size
from webgym.agent.parser import CALL_TAGS, ParsedReply, ParseError, without_thinking
from webgym.agent.profile import Profile, Thinking
from webgym.core.action import GRID, Action
from webgym.core.errors import PolicyError
from webgym.core.observation import Observation
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
        progress: the agent's latest statement of progress, which some formats repeat.
    """

    observation: Observation
    index: int
    budget: int
    memory: Mapping[str, Any] = {}
    revision: Revision = Revision()
    progress: Mapping[str, Any] = {}


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


def shown_reply(reply: Reply, profile: Profile) -> Message:
    """An earlier reply as the model sees it again: without its thinking."""
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


def picture_of(observation: Observation, config: AgentConfig, profile: Profile) -> ImageRef:
    """An observation's picture in the size that the model is sent."""
    width, height = profile.picture_size(observation.picture_size, config.image_max_side)
    return ImageRef(observation.screenshot, width, height, profile.detail)


def describe(action: Action, screen: Size = (GRID, GRID), max_chars: int = 200) -> str:
    """A short text of the action, for people and for lists of actions; at most ``max_chars`` long."""
    arguments = to_arguments(action, screen)
    name = arguments.pop("action")
    arguments_text = ", ".join(f"{key} {value!r}" for key, value in arguments.items())
    return cut_short(f"{name} {arguments_text}".strip(), max_chars)


def cut_short(text: str, max_chars: int) -> str:
    """At most so many characters of a text."""
    return text if len(text) <= max_chars else text[: max_chars - 1] + "…"
