"""Text that others wrote, made safe to show; and comparison that ignores case, white space and typography.

Every comparison of a ground truth with a page's text follows this rule: the judge's, and the scripted
policy's.
"""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache
from typing import Final

THOUGHT: Final = re.compile(r"<(?:think|thinking|thought)\s*>|(?-i:\[THINK\])|◁think▷", re.IGNORECASE)
"""Where thinking begins in a model's reply, by the tags of different families."""

THOUGHT_END: Final = re.compile(r"</(?:think|thinking|thought)\s*>|(?-i:\[/THINK\])|◁/think▷", re.IGNORECASE)
"""Where it ends."""

_TYPOGRAPHY = str.maketrans("’‘′“”–—−‐", "'''\"\"----", "\N{SOFT HYPHEN}")


_ANGLE: Final = re.compile(r"[<＜﹤◁](?!\s)")
_SQUARE: Final = re.compile(r"[\[\]［］](?=(?=\W{0,8}[^\W\d])[^\s\[\]［］\"',(){}]{2,64}[\[\]［］])")
_INVISIBLE: Final = frozenset({"Cc", "Cf", "Co", "Cs", "Cn"})


class _Shown(dict[int, int]):
    """Table for ``str.translate``: invisible characters become U+FFFD, except for line ends, tabs and the
    joiners, which are part of scripts and emoji."""

    def __missing__(self, code: int) -> int:
        character = chr(code)
        is_shown = character in "\t\n\r\u200c\u200d" or unicodedata.category(character) not in _INVISIBLE
        self[code] = value = code if is_shown else 0xFFFD
        return value


_SHOWN: Final = _Shown()


def visible(text: str) -> str:
    """A text that others wrote, in a form in which no model's chat template or tokenizer finds a token in it.

    It cannot open a turn, a picture, a thought or a tool call. No token is known by its name: every family
    writes them in angle or square brackets, so no angle bracket that opens is followed by anything but white
    space, and neither is a square bracket before a word that ends at another one. Invisible characters are
    replaced by U+FFFD. Applied again, it changes nothing.

    Args:
        text: the text, or a whole message with texts of others in it.
    """
    return _SQUARE.sub(r"\g<0> ", _ANGLE.sub(r"\g<0> ", text.translate(_SHOWN)))


def plain(text: str) -> str:
    """An untrusted text on one line, its control characters replaced, so that it is safe to print."""
    return "".join(
        character if character.isprintable() else "\N{REPLACEMENT CHARACTER}"
        for character in " ".join(text.split())
    )


def shortened(message: str, limit: int = 300) -> str:
    """A message of a foreign program on one line, without control characters.

    Args:
        message: the text.
        limit: the greatest length in characters; the rest is cut off.
    """
    text = plain(message)
    return text if len(text) <= limit else f"{text[: limit - 1]}…"


def counted(number: int, noun: str) -> str:
    """A number with its noun, such as ``1 task`` and ``1,024 tasks``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def duration(seconds: float | None) -> str:
    """``75`` as ``1:15``; a dash for ``None``."""
    if seconds is None:
        return "–"
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def fold(text: str) -> str:
    """The text with compatibility forms, typographic quotes and dashes, case and white space normalised,
    without soft hyphens."""
    return " ".join(unicodedata.normalize("NFKC", text).translate(_TYPOGRAPHY).casefold().split())


@lru_cache(maxsize=20_000)
def whole_phrase(phrase: str) -> re.Pattern[str]:
    """A pattern of a folded phrase as whole words and whole numbers; the "s" of "it's" is no word."""
    before = r"(?<!\w)(?<!\w')" if phrase[0].isalnum() else ""
    after = r"(?!\w)" if phrase[-1].isalnum() else ""
    if phrase[0].isdecimal():
        before += r"(?<!\d[.,:])"  # 2.5 does not contain 5
    if phrase[-1].isdecimal():
        after += r"(?![.,:]\d)"  # 12.50 does not contain 12
    return re.compile(before + re.escape(phrase) + after)


def says(folded: str, phrase: str) -> bool:
    """Whether the folded text contains ``phrase`` as whole words and whole numbers."""
    wanted = fold(phrase)
    return bool(wanted) and wanted in folded and whole_phrase(wanted).search(folded) is not None
