"""How long a request is, and what is left out of one that is too long.

Lengths are estimates that err upwards: what they let through, an endpoint takes. A request that is too long
is trimmed in this order until it fits, and no further:

1. screenshots of the window, oldest first; their words and replies stay;
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
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import msgspec

from webgym.agent.profile import Profile
from webgym.core.errors import PolicyError
from webgym.core.trajectory import ImageRef, Message, TextPart

_MESSAGE_TOKENS: Final = 6
"""What a chat template writes around a message."""

_PIECE = re.compile(
    r"(?P<word>(?<!\w)[A-Z]?[a-z]{1,12}(?!\w))|(?P<letters>[A-Za-z]+)"
    r"|(?P<one> (?=[A-Za-z]))|(?P<space>\s+)|(?P<ascii>[\x00-\x7f])|(?P<other>.)",
    re.DOTALL,
)
_WORD_LETTERS: Final = 5
"""Letters of a word per token. English has more, other languages that use the alphabet about as many."""

_LETTERS: Final = 1.5
"""Letters per token of what is no word: identifiers, capitals, base64; random letters have about 1.7."""


class Cut(msgspec.Struct, frozen=True):
    """What is left out of a request, oldest first each.

    Attributes:
        pictures: of the window.
        rounds: of the window.
        lines: of the list of earlier actions; it includes the rounds that are left out.
        entries: of the memory.
    """

    pictures: int = 0
    rounds: int = 0
    lines: int = 0
    entries: int = 0


Render: TypeAlias = Callable[[Cut], tuple[Message, ...]]


def text_tokens(text: str) -> int:
    """About how many tokens a text is; rather too many than too few.

    Byte-pair vocabularies differ, so this counts in what they have in common: words by their letters, digits
    and signs one by one, other scripts by the bytes of a character.
    """
    return sum(_piece_tokens(piece) for piece in _PIECE.finditer(text))


def _piece_tokens(piece: re.Match[str]) -> int:
    length = len(piece[0])
    match piece.lastgroup:
        case "word":
            return math.ceil(length / _WORD_LETTERS)
        case "letters":
            return math.ceil(length / _LETTERS)
        case "one":  # belongs to the word
            return 0
        case "space":
            return min(length, 2)
        case "other":
            return max(1, len(piece[0].encode(errors="replace")) - 1)
        case _:
            return 1


def request_tokens(messages: Sequence[Message], profile: Profile) -> int:
    """About how many tokens a request is, pictures included."""
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
        render: makes the request without what is cut.
        profile: knows what pictures cost.
        rounds: in the window.
        lines: in the list of earlier actions.
        entries: in the memory.
        most_tokens: longest request.
        most_images: most pictures in it; ``None`` for any number.

    Raises:
        PolicyError: what must not be left out is too long.
    """
    spared = 0 if most_images is None else min(rounds, max(0, rounds + 1 - most_images))
    cuts = [Cut(pictures=number) for number in range(spared, rounds + 1)]
    cuts += [Cut(pictures=rounds, lines=number) for number in range(1, lines + 1)]
    cuts += [Cut(rounds, number, lines + number) for number in range(1, rounds + 1)]
    cuts += [Cut(rounds, rounds, lines + rounds, number) for number in range(1, entries + 1)]

    def fits(cut: Cut) -> bool:
        return request_tokens(render(cut), profile) <= most_tokens

    chosen = cuts[0] if fits(cuts[0]) else None
    if chosen is None:
        place = bisect_left(cuts, True, key=fits)
        if place == len(cuts):
            least = request_tokens(render(cuts[-1]), profile)
            message = f"the request is about {least} tokens at its shortest, and {most_tokens} are allowed"
            raise PolicyError(message, hint="raise agent.request_tokens, and the endpoint's context with it")
        chosen = cuts[place]
    return render(chosen), chosen
