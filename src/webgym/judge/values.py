"""Tokens of a text that can be compared: words, and values (numbers, amounts, dates) in any spelling.

A value has *readings*, because spellings are ambiguous: 03/05/2024 is a day in March or in May, 3:30 a
time before or after noon, 5 pounds an amount of money or of mass. An amount with a unit is converted to the
base unit of its dimension, so 2 h 30 min equals 150 min.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable
from datetime import date
from decimal import Decimal, InvalidOperation
from functools import lru_cache
from typing import Final, Literal, TypeAlias

import msgspec

from webgym.judge.units import (
    AMBIGUOUS_POUNDS,
    CASED_UNITS,
    CURRENCY_SIGNS,
    CURRENCY_WORDS,
    MONTHS,
    NUMBER_WORDS,
    ORDINAL_WORDS,
    SCALES,
    SHORT_SCALES,
    UNITS,
    WEEKDAYS,
)

Reading: TypeAlias = tuple[str, str, str]
"""Kind (``number``, ``money``, ``date``, ``clock``, ``ordinal``, a dimension), unit, canonical amount."""

Gap: TypeAlias = Literal["none", "comma", "label", "strong"]
"""What separates a token from the one before: nothing but spaces, a list separator, a colon, or anything
else."""


class Value(msgspec.Struct, frozen=True):
    """An amount, a date or a time.

    Attributes:
        readings: its possible meanings.
        amount: the number as it was written, scale included; ``None`` for dates and times.
        factor: size of the unit that was written, in the dimension's base unit.
    """

    readings: frozenset[Reading]
    amount: Decimal | None = None
    factor: Decimal = Decimal(1)

    @property
    def kinds(self) -> set[str]:
        """The kinds of its readings."""
        return {kind for kind, _, _ in self.readings}


class Token(msgspec.Struct, frozen=True):
    """A word or a value.

    Attributes:
        word: the folded word; empty for a value.
        value: ``None`` for a word.
        gap: what separates it from the token before.
    """

    word: str
    value: Value | None = None
    gap: Gap = "none"


class Text(msgspec.Struct, frozen=True):
    """The tokens and signs of a text.

    Attributes:
        tokens: words and values, in order. Articles and punctuation are left out.
        signs: characters between them that are more than punctuation, in order: a question mark, an
            ellipsis, a stroke through a letter, a mathematical sign, an emoji. No rule interprets them.
    """

    tokens: tuple[Token, ...]
    signs: tuple[str, ...]


_ARTICLES: Final = frozenset({"the", "a", "an"})
_FRACTIONS: Final = re.compile(r"(?:(?<!\d)(\d{1,12})\s?)?([¼½¾⅐⅑⅒⅓⅔⅕⅖⅗⅘⅙⅚⅛⅜⅝⅞])")
_POWERS: Final = re.compile(r"(?<=\d)[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_SPACES: Final = re.compile(r"[^\S\n]+")
_LINE_ENDS: Final = re.compile(r"[\r\v\f\x1c-\x1e\x85\u2028\u2029]")
_STROKE: Final = 1
"""Combining class of strokes through a letter, which are no accents: the letter is struck out."""
_PUNCTUATION: Final = frozenset(".,;:!'\"()[]{}<>|/\\-*_#`=•·«»‹›„‚、。「」『』【】")
_FINAL_PUNCTUATION: Final = frozenset(".,;:!'\")]}>|*_`»›。」』】")
"""Punctuation that may end a text. Any other at the end is recorded as a sign."""
_RATIO: Final = "∶"
"""The sign recorded between two numbers that form one: 7/7, 1:1."""
_ELLIPSIS: Final = re.compile(r"\.{2,}")
_GROUPING_SPACE: Final = re.compile(r"(?<=\d)[\u00a0\u2009\u202f](?=\d{3}(?!\d))")
_BOUND: Final = re.compile(r"([<>≤≥≈~±]=?)(?=\s?[-$€£¥]?\s?\d)|(?<=\d)(\s?[<>≤≥≈]=?|\+(?![\w+]))")
_BOUNDS: Final = {
    "<": "under",
    ">": "over",
    "≤": "most",
    "≥": "least",
    "<=": "most",
    ">=": "least",
    "+": "plus",
}
"""Signs that make a number a bound, as words; any other such sign means "about"."""
_TAG: Final = re.compile(r"</?([a-z][a-z0-9]{0,30})[ ]?/?>", re.IGNORECASE)
_MINUS: Final = re.compile(
    rf"\b(?:minus|negative) (?=[$€£¥]?\d|(?:{'|'.join(NUMBER_WORDS)})\b)", re.IGNORECASE
)
_NAMED_NUMBER: Final = re.compile(r"\b(?:version|ver|release|v)\.?\s?$", re.IGNORECASE)
_TAIL: Final = re.compile(r"[a-z]+\d[a-z\d]*", re.IGNORECASE)
_BULLET: Final = re.compile(r"^[ \t]*(?:[-*•‣◦]|(\d{1,2})[.)])[ \t]+", re.MULTILINE)
_TYPOGRAPHY: Final = str.maketrans("’‘′“”″–—−‐‑", "'''\"\"\"-----")

_N = r"\d(?:[\d.,']*\d)?"
_MONTH = "|".join(sorted(MONTHS, key=len, reverse=True))
_SIGN = "|".join(re.escape(sign) for sign in sorted(CURRENCY_SIGNS, key=len, reverse=True))
_CODE = "|".join(sorted({code for code, _ in CURRENCY_WORDS.values()})) + r"|rs\.?"
_SCALE = "|".join(SCALES)
_WEEKDAY = rf"(?:\b(?:{WEEKDAYS})\.?,?\s+)?"
_NUMERAL = "|".join(sorted((*NUMBER_WORDS, *ORDINAL_WORDS), key=len, reverse=True))
_LABEL = r"[a-z][a-z0-9-]{0,62}"
_TOP = (
    "com|org|net|edu|gov|int|io|co|ai|info|test|example|uk|de|fr|es|it|nl|eu|ca|au|jp|cn|in|dev|app|gg|tv|me"
)

_LEXER: Final = re.compile(
    rf"""
      (?P<link>(?:https?://|\bwww\.)\S+|(?<![\w.+-])[\w.+-]{{1,64}}@(?:[\w-]{{1,63}}\.){{1,6}}[\w-]{{2,63}}
        |(?<![\w.-])(?:{_LABEL}\.){{1,6}}(?:{_TOP})\b(?:/[^\s,;]*)?)
    | (?P<iso>{_WEEKDAY}(?<!\d)\d{{4}}[-/.年]\d{{1,2}}[-/.月]\d{{1,2}}日?(?!\d))
    | (?P<numeric_date>{_WEEKDAY}(?<![\d/.-])\d{{1,2}}(?P<sep>[/.-])\d{{1,2}}(?P=sep)(?:\d{{4}}|\d{{2}})
        (?![\d/]|[.-]\d))
    | (?P<day_first>{_WEEKDAY}\b\d{{1,2}}(?:st|nd|rd|th)?[ \t]*(?:of\s+)?(?:{_MONTH})\b\.?(?:,?\s*\d{{4}}\b)?)
    | (?P<month_first>{_WEEKDAY}\b(?:{_MONTH})\.?\s+\d{{1,2}}(?:st|nd|rd|th)?\b(?![:.]\d|,\d{{3}}(?!\d))
        (?:,?\s*\d{{4}}\b)?)
    | (?P<month_year>\b(?:{_MONTH})\.?,?\s+\d{{4}}\b)
    | (?P<clock>(?<![\d:.])(?:\d{{1,2}}:\d{{2}}(?::\d{{2}})?(?:\s?[ap]\.?m\b\.?)?
        |\d{{1,2}}(?:\.\d{{2}})?\s?[ap]\.?m\b\.?)(?![:\d])|\b(?:noon|midnight)\b)
    | (?P<hours>\b\d{{1,3}}\s?h(?:rs?|ours?)?\s?\d{{1,2}}\s?m(?:ins?|inutes?)?\b)
    | (?P<feet>(?<!\d)\d{{1,2}}'\s?\d{{1,2}}(?:"|\b)(?!\d))
    | (?P<phone>(?:\+\d|\(\d|(?<!\d)\d)\d*(?:[ ()-]{{1,2}}\d+){{2,}}(?![\d.,]))
    | (?P<ordinal>\b\d+(?:st|nd|rd|th)\b)
    | (?P<money>(?P<minus>-?)(?:(?P<sign>{_SIGN})|\b(?P<code>{_CODE}))\s?(?P<minus2>-?)(?P<sum>{_N})
        (?:\s?(?P<sum_scale>(?:{_SCALE})\b)|(?P<sum_short>[kmb]\b))?)
    | (?P<number>(?<![\w.])-?{_N}|{_N})
    | (?P<number_word>(?<![\w.])-(?:{"|".join(NUMBER_WORDS)})\b|\b(?:{_NUMERAL})\b)
    | (?P<word>[^\W\d_][^\W_]*(?:'[^\W_]+)*(?:\+\+|\#|\+(?!\w)
        |(?:(?<=\b[a-z])|(?<=\bab))-(?![\w-]))?|[^\W_]+)
    """,
    re.VERBOSE | re.IGNORECASE,
)
_UNIT: Final = re.compile(
    rf"(?P<space>[ ]?)(?:(?P<scale>{_SCALE})\b[ ]?)?(?P<unit>%|per\s?cent\b|sq\.?\s?(?:ft|feet|m|km)\b"
    r"|square (?:feet|met(?:re|er)s|kilomet(?:re|er)s)\b|°\s?[cf]\b|°|degrees (?:celsius|fahrenheit)\b"
    r"|km/h\b|m/s\b|[a-z]{1,14}2?\b|[$€£¥₹₩₽])?",
    re.IGNORECASE,
)
_SPELLINGS: Final = {
    "percent": "%",
    "sqfeet": "sqft",
    "squarefeet": "sqft",
    "squaremetres": "m2",
    "squaremeters": "m2",
    "sqkm": "km2",
    "squarekilometres": "km2",
    "squarekilometers": "km2",
    "degreescelsius": "°c",
    "degreesfahrenheit": "°f",
}


@lru_cache(maxsize=1024)
def read(text: str) -> Text:
    """The words, values and signs of a text. Never raises."""
    prepared = prepare(text)
    tokens_found: list[Token] = []
    between: list[str] = []
    at = end = 0
    while match := _LEXER.search(prepared, at):
        token, at = _token(match, prepared)
        gap = prepared[end : match.start()]
        is_ratio = gap in ("/", ":") and end > 0 and prepared[end - 1].isdigit() and match[0][0].isdigit()
        between.append(_RATIO if is_ratio else gap)
        if token is not None:
            tokens_found.append(msgspec.structs.replace(token, gap=_gap(gap) if tokens_found else "none"))
        end = at
    return Text(tuple(_with_sums(_without_articles(tokens_found))), _signs(between, prepared[end:]))


def tokens(text: str) -> list[Token]:
    """The words and values of a text alone."""
    return list(read(text).tokens)


def _signs(between: list[str], rest: str) -> tuple[str, ...]:
    """The characters between tokens, and after the last, that may carry meaning."""
    signs = [sign for gap in between for sign in gap if sign not in _PUNCTUATION and not sign.isspace()]
    signs += [sign for sign in rest if sign not in _FINAL_PUNCTUATION and not sign.isspace()]
    signs += ["…" for gap in (*between, rest) for _ in _ELLIPSIS.findall(gap)]
    signs += ["!" for gap in between if gap.endswith("!") or "!=" in gap]  # "not" in code
    # A single quotation mark is a unit, as in 5", or an apostrophe with a meaning.
    signs += [mark for mark in "'\"" if sum(gap.count(mark) for gap in (*between, rest)) % 2]
    return tuple(signs)


def _without_articles(tokens_found: list[Token]) -> list[Token]:
    """The tokens without articles. An "a" that no word follows directly is a letter or a name, and kept."""
    tokens: list[Token] = []
    gap: Gap | None = None
    for index, token in enumerate(tokens_found):
        if gap is not None:  # the gap before the article becomes the gap before its word
            token, gap = msgspec.structs.replace(token, gap=gap), None
        if (
            token.word in _ARTICLES
            and index + 1 < len(tokens_found)
            and tokens_found[index + 1].gap == "none"
        ):
            gap = token.gap
        else:
            tokens.append(token)
    return tokens


def prepare(text: str) -> str:
    """The text with typography normalised: fractions, dashes, quotes, spaces, accents, bullets. Case is
    kept."""
    text = _FRACTIONS.sub(_fraction, text)
    text = _POWERS.sub(lambda match: "^" + unicodedata.normalize("NFKC", match[0]), text)
    text = _GROUPING_SPACE.sub("", text)
    text = unicodedata.normalize("NFKC", text).translate(_TYPOGRAPHY)
    text = "".join(character for character in text if unicodedata.category(character) != "Cf")
    text = _SPACES.sub(" ", _LINE_ENDS.sub("\n", text))
    text = _without_accents(text)
    text = _TAG.sub(r" | \1 | ", text)
    text = _without_bullets(text).replace("&", " and ")
    text = _MINUS.sub("-", text)
    return _BOUND.sub(lambda match: f" {_BOUNDS.get(match[0].strip(), 'about')} ", text)


def _without_bullets(text: str) -> str:
    """The text without the bullets and numbers of list items; numbers that do not count up from 1 are
    kept."""
    following = 1

    def stripped(match: re.Match[str]) -> str:
        nonlocal following
        if match[1] is not None:
            if int(match[1]) not in (1, following):
                return match[0]
            following = int(match[1]) + 1
        return ""

    return _BULLET.sub(stripped, text)


def _fraction(match: re.Match[str]) -> str:
    value = Decimal(str(round(unicodedata.numeric(match[2]), 6)))
    return f"{int(match[1]) + value}" if match[1] else f" {value}"


def _without_accents(text: str) -> str:
    """The text without accents on Latin letters; in other scripts, marks are letters of their own."""
    characters: list[str] = []
    for character in unicodedata.normalize("NFD", text):
        mark = unicodedata.combining(character)
        if mark and mark != _STROKE and characters and characters[-1].isascii():
            continue
        characters.append(character)
    return unicodedata.normalize("NFC", "".join(characters))


def _gap(between: str) -> Gap:
    if between == "-" or not between.strip(" *_`"):  # one word, as in blue-green; emphasis
        return "none"
    if any(character in between for character in ":="):
        return "label"
    return "comma" if any(character in between for character in ",;\n/|") else "strong"


def _token(match: re.Match[str], text: str) -> tuple[Token | None, int]:
    """The token at a match of the lexer (``None`` for none), and the index at which to continue."""
    raw = match[0]
    kind = match.lastgroup  # the outermost one
    if kind == "link":
        raw = raw.rstrip(".,;:!?)\"'")
        plain = re.sub(r"^(?:https?://)?(?:www\.)?", "", raw.casefold()).rstrip("/")
        return Token(plain), match.start() + max(1, len(raw))
    if kind == "money":
        return _money(match, text)
    if kind in ("number", "number_word"):
        return _number(match, text)
    if kind == "word":
        return _word(raw), match.end()
    if (value := _READERS[str(kind)](match)) is not None:
        return Token("", value), match.end()
    # It looks like a date, a time or a telephone number but is not: take only its first piece.
    piece = re.match(r"\W*([^\W_]+)", raw)
    if piece is None:
        return None, match.end()
    amount = read_number(piece[1])
    token = Token("", _amount_of("number", "", amount)) if amount is not None else _word(piece[1])
    return token, match.start() + piece.end()


def _word(raw: str) -> Token:
    return Token(raw.casefold().replace("'", ""))


def read_number(text: str) -> Decimal | None:
    """A number in English notation or with a decimal comma; ``None`` if the text is not a number.

    A single comma before three digits separates thousands, a single point never does.
    """
    sign, digits = (-1, text[1:]) if text.startswith("-") else (1, text)
    if re.fullmatch(r"\d{1,3}(?:[,' ]\d{3})+(?:\.\d+)?|\d{1,2}(?:,\d{2})+,\d{3}(?:\.\d+)?", digits):
        digits = re.sub(r"[,' ]", "", digits)
    elif re.fullmatch(r"\d{1,3}(?:\.\d{3})+,\d+|\d{1,3}(?:\.\d{3}){2,}", digits):
        digits = digits.replace(".", "").replace(",", ".")
    elif re.fullmatch(r"\d+,\d{1,2}", digits):
        digits = digits.replace(",", ".")
    elif not re.fullmatch(r"\d+(?:\.\d+)?", digits):
        return None
    try:
        return sign * Decimal(digits)
    except InvalidOperation:
        return None


def canonical(amount: Decimal) -> str:
    """The number as text, without exponent and trailing zeros."""
    text = f"{amount:f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text in ("-0", "") else text


def _amount_of(kind: str, unit: str, amount: Decimal, factor: Decimal = Decimal(1)) -> Value:
    return Value(frozenset({(kind, unit, canonical(amount * factor))}), amount, factor)


def _number(match: re.Match[str], text: str) -> tuple[Token | None, int]:
    """The token of a number together with the unit after it, and the index at which to continue."""
    raw = match[0].casefold()
    if raw in ORDINAL_WORDS:
        return Token("", _amount_of("ordinal", "", Decimal(ORDINAL_WORDS[raw]))), match.end()
    if (word := raw.removeprefix("-")) in NUMBER_WORDS:
        amount: Decimal | None = Decimal(NUMBER_WORDS[word]) * (-1 if raw.startswith("-") else 1)
    else:
        amount = read_number(raw)
    is_version = _NAMED_NUMBER.search(text, max(0, match.start() - 12), match.start())
    if amount is None or is_version:  # an address, a list without spaces
        return Token(raw), match.end()
    after = _UNIT.match(text, match.end())
    assert after is not None
    attached = "" if after["space"] or after["scale"] else after["unit"] or ""
    if attached in ("M", "B", "k", "K"):
        return Token("", _amount_of("number", "", amount * SHORT_SCALES[attached.lower()])), after.end()
    if (after["unit"] or "").casefold() == "in" and not re.match(
        r"\s+\w", text[after.end() : after.end() + 9]
    ):
        return Token(
            "", _amount_of("length", "", amount, UNITS["inch"][1])
        ), after.end()  # else a preposition
    if after["scale"]:
        amount *= SCALES[after["scale"].casefold()]
    if value := _with_unit(amount, after["unit"] or ""):
        return Token("", value), after.end()
    end = after.end("scale") if after["scale"] else match.end()
    if end == match.end() and attached:  # 4x4, 3D, A4: a name that begins with a digit
        return Token(raw + attached.casefold()), after.end()
    if end == match.end() and (tail := _TAIL.match(text, end)):  # 1e6, 3f2a
        return Token(raw + tail[0].casefold()), tail.end()
    if re.fullmatch(r"0\d+", raw):  # a code: its zeros count
        return Token(raw), end
    return Token("", _amount_of("number", "", amount)), end


def _with_unit(amount: Decimal, unit: str) -> Value | None:
    """The amount with this unit; ``None`` if it is not a known unit."""
    if unit in CASED_UNITS:
        return _amount_of(CASED_UNITS[unit], "", amount)
    name = re.sub(r"[\s.]", "", unit.casefold())
    name = _SPELLINGS.get(name, name)
    if name in AMBIGUOUS_POUNDS:
        pounds = _amount_of("mass", "", amount, UNITS["lb"][1])
        return msgspec.structs.replace(
            pounds, readings=pounds.readings | {("money", "GBP", canonical(amount))}
        )
    if name in CURRENCY_SIGNS:
        return _amount_of("money", CURRENCY_SIGNS[name], amount)
    if name in CURRENCY_WORDS:
        currency, factor = CURRENCY_WORDS[name]
        return _amount_of("money", currency, amount, factor)
    if name in UNITS:
        dimension, factor = UNITS[name]
        return _amount_of(dimension, "", amount, factor)
    return None


def _money(match: re.Match[str], text: str) -> tuple[Token | None, int]:
    amount = read_number(match["sum"])
    code = (match["code"] or "").casefold().rstrip(".")
    currency = CURRENCY_SIGNS[match["sign"].casefold()] if match["sign"] else CURRENCY_WORDS[code][0]
    if amount is None:
        return Token(match[0].casefold()), match.end()
    if scale := match["sum_scale"] or match["sum_short"]:
        amount *= (SCALES | SHORT_SCALES)[scale.casefold()]
    if match["minus"] or match["minus2"]:
        amount = -amount
    # "$12.50 USD" has its currency twice.
    twice = re.compile(rf"\s?(?:{currency}|dollars)\b", re.IGNORECASE).match(text, match.end())
    return Token("", _amount_of("money", currency, amount)), twice.end() if twice else match.end()


def _date_reading(year: int | None, month: int, day: int | None) -> Reading | None:
    try:
        date(year or 2000, month, day or 1)
    except ValueError:
        return None
    return "date", "", f"{year or '?'}-{month:02d}-{day or '?'}"


def _date_value(*readings: Reading | None) -> Value | None:
    known = frozenset(reading for reading in readings if reading is not None)
    return Value(known) if known else None


def _iso(match: re.Match[str]) -> Value | None:
    year, month, day = (int(piece) for piece in re.findall(r"\d+", match[0]))
    return _date_value(_date_reading(year, month, day))


def _numeric_date(match: re.Match[str]) -> Value | None:
    first, second, year = (int(piece) for piece in re.findall(r"\d+", match[0]))
    if year < 100:
        year += 2000 if year < 70 else 1900
    day_first = _date_reading(year, second, first)
    return (
        _date_value(day_first)
        if match["sep"] == "."
        else _date_value(day_first, _date_reading(year, first, second))
    )


def _named_date(match: re.Match[str]) -> Value | None:
    weekday = re.match(rf"(?:{WEEKDAYS})\b\.?,?\s+", match[0], re.IGNORECASE)
    text = match[0][weekday.end() :] if weekday else match[0]
    text = re.sub(r"(?<=\d)(?:st|nd|rd|th)", " ", text, flags=re.IGNORECASE)
    month = next(MONTHS[word] for word in re.findall(r"[a-z]+", text.casefold()) if word in MONTHS)
    numbers = [int(piece) for piece in re.findall(r"\d+", text)]
    year = next((number for number in numbers if number > 31), None)
    day = next((number for number in numbers if number <= 31), None)
    return _date_value(_date_reading(year, month, day))


def _clock(match: re.Match[str]) -> Value | None:
    text = match[0].casefold()
    if text in ("noon", "midnight"):
        return Value(frozenset({("clock", "", "12:00" if text == "noon" else "00:00")}))
    hour, minute, *_ = [int(piece) for piece in re.findall(r"\d+", text)] + [0]
    half = re.search(r"[ap](?=\.?m)", text)
    if minute > 59 or hour > (12 if half else 24) or (half and hour == 0):
        return None
    if half:
        hours = {hour % 12 + (12 if half[0] == "p" else 0)}
    elif 1 <= hour <= 12 and not text.startswith("0"):
        hours = {hour, (hour + 12) % 24}
    else:
        hours = {hour % 24}
    return Value(frozenset(("clock", "", f"{hour_of_day:02d}:{minute:02d}") for hour_of_day in hours))


def _hours(match: re.Match[str]) -> Value | None:
    hours, minutes = (Decimal(piece) for piece in re.findall(r"\d+", match[0]))
    return _amount_of("time", "", hours * 60 + minutes, UNITS["min"][1])


def _feet(match: re.Match[str]) -> Value | None:
    feet, inches = (Decimal(piece) for piece in re.findall(r"\d+", match[0]))
    return _amount_of("length", "", feet * UNITS["ft"][1] + inches * UNITS["inch"][1])


def _phone(match: re.Match[str]) -> Value | None:
    digits = "".join(re.findall(r"\d", match[0]))
    if (amount := read_number(match[0])) is not None:
        return _amount_of("number", "", amount)
    if len(digits) < 7:
        return None
    return Value(frozenset({("identifier", "", ("+" if match[0].startswith("+") else "") + digits)}))


def _ordinal(match: re.Match[str]) -> Value | None:
    return _amount_of("ordinal", "", Decimal(re.sub(r"\D", "", match[0])))


_READERS: Final[dict[str, Callable[[re.Match[str]], Value | None]]] = {
    "iso": _iso,
    "numeric_date": _numeric_date,
    "day_first": _named_date,
    "month_first": _named_date,
    "month_year": _named_date,
    "clock": _clock,
    "hours": _hours,
    "feet": _feet,
    "phone": _phone,
    "ordinal": _ordinal,
}
_SUMMED_DIMENSIONS: Final = frozenset({"time", "length", "mass", "months"})
"""Dimensions whose amounts are often written in several units: 2 h 30 min, 5 ft 10 in, 7 lb 3 oz."""


def _with_sums(tokens_found: list[Token]) -> list[Token]:
    """The tokens, with adjacent amounts in decreasing units of one dimension added up."""
    summed: list[Token] = []
    pending_and: Token | None = None
    for token in tokens_found:
        if token.word == "and" and summed and summed[-1].value and pending_and is None:
            pending_and = token
            continue
        before = summed[-1].value if summed else None
        if before and token.value and token.gap not in ("label", "strong") and _adds_up(before, token.value):
            total = _base_amount(before) + _base_amount(token.value)
            (kind,) = before.kinds
            both = Value(
                frozenset({(kind, "", canonical(total))}), total / token.value.factor, token.value.factor
            )
            summed[-1] = msgspec.structs.replace(summed[-1], value=both)
        else:
            summed.extend([pending_and] if pending_and else [])
            summed.append(token)
        pending_and = None
    return [*summed, pending_and] if pending_and else summed


def _adds_up(before: Value, after: Value) -> bool:
    return (
        len(before.readings) == len(after.readings) == 1
        and before.kinds == after.kinds
        and before.kinds <= _SUMMED_DIMENSIONS
        and before.factor > after.factor
    )


def _base_amount(value: Value) -> Decimal:
    ((_, _, amount),) = value.readings
    return Decimal(amount)
