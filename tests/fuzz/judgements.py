"""Judge replies and answers whose meaning is known, and what is wrong with a reading of them."""

from __future__ import annotations

import random
from dataclasses import dataclass
from datetime import date, timedelta
from typing import Any

from tests.judge.scenes import reads

from webgym.judge.reference import Match, compare
from webgym.judge.verdicts import Finding, Words, may_be_echoed, read_verdict
from webgym.judge.webjudge import read_status

CODE = "5f0c1e9a77b2"
_TURNING = (
    *(
        "Not a",
        "No",
        "It is not",
        "It can not be called",
        "I would not say",
        "It isn't",
        "It isn’t a",
        "Never a",
    ),
    *("It is neither done nor", "If it were shown, I would say", "It would be", "Hardly a", "Without any"),
)
"""What a verdict after it would not be: a negation or a condition."""
_LEADING = (
    "It is anything but",
    "That is far from a",
    "The page says",
    "It stopped short of",
    "Some call it",
)
"""What runs on into a verdict, too, though no word of it says so."""
_SENTENCES = (
    "Step 3 shows it.",
    "The page does not hide it!",
    'It says "done."',
    "Was it found? Step 2 shows it.",
    "**Seen at step 4.**",
)
_SAID: dict[Words, tuple[str, str]] = {"criterion": ("SUCCESS", "NOT SUCCESS"), "question": ("YES", "NO")}
_PIECES = [
    *"VERDICT VERDICT: Verdict SUCCESS NOT success Success YES NO no yes".split(),
    *": = - ** ``` > | # \" ' . , ( )".split(),
    *"<think> </think> <|im_end|> ＳＵＣＣＥＳＳ ＶＥＲＤＩＣＴ： 0123456789ab Status: failure".split(),
    *"SCREENSHOT 1: IMAGE".split(),
    *"step 3 shows the price $12.50 {} [] \u200b \u202e ß İ ı 日本".split(" "),
    *("\n", "\n\n", "\r\n", "\n> ", "\n| ", "\u2028"),
]


@dataclass(frozen=True)
class Case:
    """One input, what may come out, and what did."""

    kind: str
    text: str
    allowed: tuple[Any, ...]
    found: Any

    @property
    def is_wrong(self) -> bool:
        return self.found not in self.allowed


class Generator:
    """Cases, each from its seed."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)

    def case(self) -> Case:
        makers = (
            self.signed,
            self.cut,
            self.echo,
            self.contradiction,
            self.soup,
            self.status,
            self.broken,
            self.whole,
            self.told_status,
            self.same,
            self.other,
        )
        return self.rng.choice(makers)()

    def noise(self, most: int = 25) -> str:
        gap = self.rng.choice(("", " ", " ", "\n"))
        return gap.join(self.rng.choices(_PIECES, k=self.rng.randrange(most)))

    def _reply(self) -> tuple[Words, bool, str]:
        words: Words = self.rng.choice(("criterion", "question"))
        passed = self.rng.random() < 0.5
        said = _SAID[words][not passed]
        line = f"VERDICT {CODE}: {said}"
        line = self.rng.choice(
            (line, line.lower(), line.title(), f"**{line}**", f"`{line}`", f"- {line}.", f"# {line}")
        )
        return words, passed, line

    @staticmethod
    def _read(text: str, words: Words, **more: Any) -> bool | None:
        found = reads(read_verdict, text, words, CODE, **more)
        return found.passed if isinstance(found, Finding) else None

    def signed(self) -> Case:
        """A signed verdict after a whole sentence is that verdict; an open thought takes it."""
        words, passed, line = self._reply()
        line += self.rng.choice(("", "", "\u200b", "<|im_end|>", "<｜end▁of▁sentence｜>\n", "\n<|eot|>"))
        end = self.rng.choice(("", chr(10), "  ", chr(10) * 2))
        text = f"{self.noise()}\n{self.rng.choice(_SENTENCES)}\n{line}{end}"
        is_open = "<think>" in text.casefold().split("</think>")[-1]
        return Case("signed", text, (None,) if is_open else (passed,), self._read(text, words))

    def cut(self) -> Case:
        """A reply that lacks its end has its verdict or none, never the other."""
        words, passed, line = self._reply()
        before = self.rng.choice(
            ("Step 3 shows it.", "Clearly nothing. Not a success at first.", "It says no and yes.")
        )
        whole = f"{before}\n{line}"
        text = whole[: self.rng.randrange(len(whole) + 1)]
        said = line.casefold().rstrip("*`. ")
        is_whole = text.casefold().rstrip("*`. ").endswith(said)
        return Case("cut", text, (passed,) if is_whole else (None,), self._read(text, words))

    def echo(self) -> Case:
        """A piece of what was quoted is no verdict."""
        words: Words = "criterion"
        quoted = self.noise(40)
        start, end = sorted(self.rng.choices(range(len(quoted) + 1), k=2))
        bare = not may_be_echoed([quoted], words)
        text = self.rng.choice(("", "The page says:\n")) + quoted[start:end]
        return Case("echo", text, (None,), self._read(text, words, bare=bare))

    def contradiction(self) -> Case:
        words, _, _ = self._reply()
        lines = [f"VERDICT {CODE}: {said}" for said in _SAID[words]]
        self.rng.shuffle(lines)
        text = f"{self.rng.choice(('', 'Hm.'))}\n" + self.rng.choice(("\n", "\nBut then:\n", "\n\n")).join(
            lines
        )
        return Case("contradiction", text, (None,), self._read(text, words))

    def soup(self) -> Case:
        """Anything at all is read without an error."""
        text = self.noise(200)
        return Case(
            "soup", text, (True, False, None), self._read(text, "question", bare=self.rng.random() < 0.5)
        )

    def status(self) -> Case:
        passed = self.rng.random() < 0.5
        line = f"Status: {'success' if passed else 'failure'}"
        line = self.rng.choice(
            (line, f"**{line}**", line.replace(": ", ': "') + '"', line + ".", line.upper())
        )
        thoughts = (
            "Thoughts: it shows “Status: Processing” and a success message, or a failure to load, at step 3."
        )
        whole = f"{thoughts}\n{line}"
        if self.rng.random() < 0.5:
            return Case("status", whole, (passed,), read_status(whole))
        text = whole[: self.rng.randrange(len(whole) - 9)]
        return Case("status cut", text, (None,), read_status(text))

    def _break(self, fragments: tuple[str, ...]) -> str:
        """A beginning and its line's end, somewhere after anything."""
        mark, rng = self.rng.choice(("", "", "**", "_", "`")), self.rng
        end = rng.choice(("", " ", ":", ",", "...", "…", " -", ": "))
        gap = rng.choice(("\n", "\n\n", "\r\n", " \n\t\n", "\u2028"))
        return f"{rng.choice(_SENTENCES)} {mark}{rng.choice(fragments)}{end}{mark}{gap}"

    def broken(self) -> Case:
        """A verdict that is the end of another sentence is none."""
        words, passed, _ = self._reply()
        said = _SAID[words][not passed]
        line = self.rng.choice(
            (said, said.lower(), f"**{said}**", f"{said}.", f"VERDICT: {said}", f"- {said}")
        )
        text = self._break((*_TURNING, *_LEADING)) + line
        if passed and self.rng.random() < 0.5:  # nor is a signed one that is denied
            text = self._break(_TURNING) + f"VERDICT {CODE}: {said}"
        return Case("broken", text, (None,), self._read(text, words))

    def whole(self) -> Case:
        """A verdict after whole sentences is one, though it lacks the code."""
        words, passed, _ = self._reply()
        said = _SAID[words][not passed]
        line = self.rng.choice((said, f"**{said}**", f"{said}.", f"VERDICT: {said}", f"`VERDICT: {said}`"))
        text = "\n".join((*self.rng.choices(_SENTENCES, k=self.rng.randrange(3)), line))
        return Case("whole", text, (passed,), self._read(text, words))

    def told_status(self) -> Case:
        """A status that is asked, denied, quoted or supposed is none."""
        said = self.rng.choice(("success", "Success", '"success"', "failure"))
        line = f"Status: {said}"
        text = self.rng.choice(
            (
                f"Thoughts: {self._break(_TURNING)}{line}",
                f"Thoughts: {self.rng.choice((*_TURNING, *_LEADING))} {line.lower()}",
                f"Thoughts: it says this.\n{self.rng.choice(('“', '> ', '| ', '**“', chr(39)))}{line}",
                f"Thoughts: is it done?\n{line}{self.rng.choice(('?', '？', ' ?', '?!', ' or not'))}",
                f"Thoughts: if {line.lower()}",
                f"Thoughts: it loads.\n{line}\n{self.rng.choice(('would be wrong.', 'if it loads'))}",
            )
        )
        return Case("told status", text, (None,), read_status(text))

    # --- values in many spellings ---------------------------------------------------------------------

    def spellings(self) -> tuple[list[str], list[str]]:
        """Spellings of one value, and of another of its kind."""
        rng = self.rng
        kind = rng.choice(("number", "money", "date", "duration", "length"))
        if kind == "date":
            day = date(1990, 1, 1) + timedelta(rng.randrange(20_000))
            return self._dates(day), self._dates(day + timedelta(rng.choice((1, -1, 31, 365))))
        if kind == "duration":
            minutes = rng.randrange(61, 600)
            return self._durations(minutes), self._durations(minutes + rng.choice((1, 10, 60)))
        if kind == "length":
            metres = rng.randrange(1, 90) * 100
            return (
                [f"{each} m" for each in (metres, f"{metres:,}")] + [f"{metres / 1000:g} km"],
                [f"{metres + 100} m", f"{metres} km", f"{metres / 100:g} km"],
            )
        cents = rng.randrange(100, 10_000_000)
        amounts, others = self._amounts(cents), self._amounts(cents + rng.choice((1, 100, 1_000)))
        if kind == "number":
            return amounts, others
        return (
            [f"${a}" for a in amounts] + [f"{a} dollars" for a in amounts] + [f"USD {a}" for a in amounts],
            [f"${a}" for a in others] + [f"€{a}" for a in amounts] + [f"{a} euros" for a in others],
        )

    @staticmethod
    def _amounts(cents: int) -> list[str]:
        whole, rest = divmod(cents, 100)
        found = [
            f"{whole}.{rest:02d}",
            f"{whole:,}.{rest:02d}",
            f"{whole:,}".replace(",", ".") + f",{rest:02d}",
        ]
        return found + ([f"{whole}", f"{whole:,}", f"{whole:,}".replace(",", "\u202f")] if rest == 0 else [])

    @staticmethod
    def _dates(day: date) -> list[str]:
        number, year = day.day, day.year
        suffix = "th" if 10 <= number % 100 <= 20 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
        return [
            day.isoformat(),
            f"{day:%B} {number}, {year}",
            f"{number} {day:%B} {year}",
            f"{number} {day:%b} {year}",
            f"{day:%A}, {day:%B} {number}{suffix}, {year}",
            f"the {number}{suffix} of {day:%B} {year}",
            f"{number}.{day.month}.{year}",
            f"{year}/{day.month}/{number}",
        ]

    @staticmethod
    def _durations(minutes: int) -> list[str]:
        hours, rest = divmod(minutes, 60)
        found = [f"{minutes} min", f"{minutes} minutes"]
        if rest:
            found += [f"{hours} h {rest} min", f"{hours}h{rest}m", f"{hours} hours and {rest} minutes"]
        return found

    def _told(self, value: str) -> str:
        return self.rng.choice(
            (value, f"{value}.", f"It is {value}.", f"The answer is {value}.", f"Answer: {value}")
        )

    def same(self) -> Case:
        """Two spellings of one value are never another value."""
        right, _ = self.spellings()
        one, other = self.rng.choice(right), self._told(self.rng.choice(right))
        found = compare(one, other).match
        return Case("same", f"{one} / {other}", (Match.SAME, Match.UNSURE), found)

    def other(self) -> Case:
        """Spellings of two values are never the same."""
        right, wrong = self.spellings()
        one, other = self.rng.choice(right), self._told(self.rng.choice(wrong))
        found = compare(one, other).match
        return Case("other", f"{one} / {other}", (Match.DIFFERENT, Match.UNSURE), found)
