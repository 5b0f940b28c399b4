"""Error rates of the rule that compares answers with reference answers, on generated answers.

    .venv/bin/python benchmarks/reference_answers.py
    .venv/bin/python benchmarks/reference_answers.py --data ../shared/data --per-reference 4 --seed 2

Wrong answers contain the reference among other candidates (lists, tables, choices), deny it, date it to the
past or give it another unit, scale or sign: saying "same" of one would be a false reward. Right answers
contain it in a plain wrapping: saying "different" of one would be a false zero. An unsure one costs a model
call. The references are those of the offline web and, if ``--data`` contains them, of the benchmarks' files.
"""

from __future__ import annotations

import argparse
import random
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Final

from webgym.core.errors import WebGymError
from webgym.judge.reference import Match, compare
from webgym.offline.web import OfflineWeb
from webgym.tasks.sampling import draw
from webgym.tasks.sources import read_source

FOLDERS: Final = {
    "pae-webvoyager": "webvoyager",
    "browsecomp": "browsecomp",
    "agentsynth-web": "agentsynth-web",
}


@dataclass(frozen=True)
class Known:
    """A reference answer and its task."""

    source: str
    instruction: str
    reference: str


@dataclass(frozen=True)
class Case:
    """An answer to compare with a reference, and whether it is right."""

    family: str
    instruction: str
    reference: str
    answer: str
    is_right: bool

    @property
    def match(self) -> Match:
        """What the rule says."""
        return compare(self.reference, self.answer).match


COUNTS: Final = (*(1,) * 8, *(2,) * 4, *(3,) * 4, *(5,) * 4, *(10,) * 4, *(30,) * 2, 100)
"""Numbers of other candidates in a list, one of which is drawn: mostly small ones, which are faster."""
SEPARATORS: Final = (
    ". ", ".", ", ", ",", "; ", ";", ": ", "/", " / ", "|", " | ", "\\", " - ", "-- ", " – ", " — ", "–", "—",
    "\n", "\n\n", "\r\n", "\n- ", "\n* ", "\n• ", "\t", "  ", " ", " · ", " • ", "! ", "… ", " ... ", "? ",
    ") (", "] [", "} {", '" "', "' '", "” “", "» «", "` `", "** **", "__ __", "*, *", "<br>", "</li><li>",
    "\u2028", "\u2029", "\x0b", "\x0c", "\x85", "\u00a0", "\u3000", "\u200b", "\u200b ", "\u2060", "\ufeff ",
    "、", "。", "，", "；", "・", "؛ ", "، ", "।", "‖", "¦", "⁄", "∕", "‧", "․", "﹐", "｜", "／", "᛫", "⸱",
    " → ", " ⇒ ", " ➡ ", " ✅ ", " ❌ ", "🔹", " ★ ", " + ", " = ", " ~ ", " & ", " @ ", " # ", " ^ ", " % ",
    " and ", " or ", " and/or ", " also ", " plus ", " then ", " as well as ", " besides ", " with ", " for ",
    " is ", " it is ", " is it ", " was ", " that is ", " which is ", " of ", " to ", " in ", " on ",
    " from ", " has ", " found ", " here ", " there ", " so ", " the ", " a ", " final answer ", " answer ",
    " result ",
)  # fmt: skip
BRACKETS: Final = (
    ("", ""), ("(", ")"), ("[", "]"), ('"', '"'), ("“", "”"), ("**", "**"), ("`", "`"), ("<", ">"),
)  # fmt: skip
EACH: Final = (
    "It is {}. ", "The answer is {}. ", "I found {}. ", "Answer: {}\n", "answer {}; ", "It was {}, ",
    "{} is it. ", "Final answer: {}\n\n", "The result is {}\n", "There is {}. ", "I found that it is {}. ",
    "- It is {}\n", "According to the page it is {}. ", "On the page: {}. ", "In {}. ", "Here is {}. ",
    "Here: {}, ", "to {}, ", "the website says {}, ", "named {}; ", "that is {} ", "it is {} ", "is {} ",
    "found {} and ", "Result {}\n",
)  # fmt: skip
"""Forms of a candidate in a sequence of candidates."""
WHOLE: Final = (
    "{}", "{}.", "The answer is {}.", "It is {}", "Answer: {}", "I found {}.", "The answers are: {}", "{} ",
)  # fmt: skip
PAIRS: Final = {
    "choice": (
        "either {r} or {o}", "{o} or {r}", "{r}/{o}", "{r} vs. {o}", "It is {r} or {o}.", "{r} or else {o}",
        "{r} (or {o})", "{r}, alternatively {o}", "one of {r}, {o}", "{r}; if not, {o}", "{r} ({o})",
        "{o} ({r})", "{r} = {o}", "{r}, possibly {o}", "first {r}, second {o}", "1. {r} 2. {o}",
        "a) {r} b) {o}", "{r}|{o}", "between {r} and {o}", "from {r} to {o}", "{r}-{o}", "{r} – {o}",
        "{r}..{o}", "{r} to {o}", "{r}~{o}",
    ),
    "negation": (
        "not {r}", "It is not {r}.", "It isn't {r}", "not {r} but {o}", "{o}, not {r}", "{r} is wrong",
        "non-{r}", "It is not {r}; it is {o}.", "anything but {r}", "never {r}", "{r}? no, {o}",
        "{r} is false", "no {r}", "~~{r}~~", "~~{r}~~ {o}", "<del>{r}</del> {o}", "<s>{r}</s>", "❌ {r}",
        "❌ {r}\n✅ {o}", "≠ {r}", "¬{r}", "it is neither {r} nor {o}", "{o} instead of {r}", "hardly {r}",
        "{o} rather than {r}", "except {r}", "{r} ✗", "The answer is {o} (not {r}).", "{r} is not the answer",
        "I ruled out {r}", "all except {r}", "🚫 {r}",
    ),
    "past": (
        "previously {r}, now {o}", "{r} previously, {o} now", "It was {r}, it is now {o}.", "formerly {r}",
        "{r} until 2020, then {o}", "It used to be {r}.", "{o} (previously {r})", "It was {r} before {o}.",
        "{r}, since replaced by {o}", "ex-{r}", "old: {r}, new: {o}", "It was {r}. It is {o}.",
        "no longer {r}", "{r} (outdated)", "once {r}", "{r} was the answer; today it is {o}",
        "the former {r}", "originally {r}",
    ),
    "hedge": (
        "maybe {r}", "It might be {r}.", "perhaps {r}", "I guess {r}", "I could not find it; {r}", "{r}?",
        "¿{r}", "{r} or not", "{r} I think", "probably {r}", "I am not sure: {r}", "unknown; {r}",
        "at most {r}", "{r} …", "about {r}", "{r} or so", "could be {r}", "I failed, {r}", "Sorry, {r}",
        "No answer. {r}", "{r}, unless {o}",
    ),
    "record": (
        '{{"answer": "{r}", "other": "{o}"}}', '["{r}", "{o}"]', '{{"candidates": ["{o}", "{r}"]}}',
        "answer: {r}\nor: {o}", "| {r} | {o} |", "| Answer |\n|---|\n| {r} |\n| {o} |",
        "<ul><li>{r}</li><li>{o}</li></ul>", "{r},{o}\n", "<answer>{r}</answer><answer>{o}</answer>",
        "- {r}\n- {o}", "1) {r}\n2) {o}", "\\boxed{{{r}}} \\boxed{{{o}}}", "A: {r}\nB: {o}", "# {r}\n## {o}",
        "> {r}\n> {o}", "{r}\n---\n{o}", "[x] {r}\n[ ] {o}", "{r}\t{o}",
    ),
}  # fmt: skip
QUANTITIES: Final = (
    "{r} miles", "{r} km", "{r}%", "{r} dollars", "${r}", "€{r}", "{r} million", "{r}k", "minus {r}", "-{r}",
    "−{r}", "negative {r}", "{r}+", "{r} or more", ">{r}", "~{r}", "{r} hours", "{r}°", "{r}'", '{r}"',
    "{r}‰", "{r}¢", "{r} nautical miles", "{r} leagues", "{r} squared", "{r}²", "{r}^2", "{r}/7", "{r}:1",
    "{r} quarters", "1/{r}", "{r} below", "{r} dozen", "{r}x", "{r}!!1", "{r}e3", "{r} square feet", "{r}½",
    "minus  {r}", "({r} fewer)",
)  # fmt: skip
WRAPPINGS: Final = (
    "{}", "{}.", " {} ", "{}!", "**{}**", "*{}*", "`{}`", '"{}"', "“{}”", "'{}'", "({})", "[{}]", "# {}",
    "- {}", "The answer is {}.", "the answer is {}", "The answer is: {}", "The answer is **{}**.",
    "The answer is “{}”.", "Answer: {}", "answer = {}", "**Answer:** {}", "Answer:\n{}", "Final answer: {}",
    "FINAL ANSWER: {}", "A: {}", "The final answer is {}.", "The answer to the question is:\n\n{}",
    "The answer to your question is {}.", "It is {}.", "It's {}.", "That is {}.", "This is {}.", "It was {}.",
    "The result is {}.", "The result: {}", "I found {}.", "I found that it is {}.", "I found the answer: {}.",
    "I have found the answer. It is {}.", "Here is the answer: {}", "Here it is: {}",
    "Here is what I found: {}", "Sure! The answer is {}.", "According to the website, it is {}.",
    "According to the page, the answer is {}.", "Based on the page, it is {}.",
    "Based on the information on the website, the answer is {}.", "It is {}, according to the website.",
    "I searched the website and found {}.", "I looked at the page. The answer is {}.", "So the answer is {}.",
    "Therefore, the answer is {}.", "The answer is {}. Task completed.", "Done. {}", "The task is done: {}",
    "<answer>{}</answer>", '{{"answer": "{}"}}', "\\boxed{{{}}}", "```\n{}\n```", "Thus: {}", "{}\n\n{}",
)  # fmt: skip
SHOUT: Final[tuple[Callable[[str], str], ...]] = (str, str, str.lower, str.upper, str.capitalize)


class Families:
    """Generates cases about references.

    Args:
        known: the references; those of the same source and shape are candidates for each other.
        seed: of all random choices.
    """

    def __init__(self, known: Sequence[Known], seed: int = 1) -> None:
        self.known = known
        self._rng = random.Random(seed)
        self._pools: dict[tuple[str, str], list[str]] = {}
        for one in known:
            pool = self._pools.setdefault((one.source, _shape(one.reference)), [])
            pool += [*one.reference.split("; "), one.reference]
        self._all = [one.reference for one in known]

    def wrong(self, one: Known) -> Iterator[Case]:
        """A wrong answer of every family."""
        rng, reference = self._rng, one.reference
        candidates = [reference, *self.rivals(one, rng.choice(COUNTS))]
        rng.shuffle(candidates)
        yield self._case("list", one, self._joined(candidates))
        each = rng.choice(EACH)
        yield self._case("each in a sentence", one, "".join(each.format(item) for item in candidates))
        several = [rng.choice(EACH).format(item) for item in candidates]
        yield self._case("each in another sentence", one, "".join(several))
        yield from self._named(one, candidates)
        other = candidates[0] if candidates[0] != reference else candidates[1]
        for family, forms in PAIRS.items():
            yield self._case(family, one, rng.choice(forms).format(r=reference, o=other))
        yield from self._choices(one, candidates)
        items = reference.split("; ")
        if len(items) > 1:
            extra = [*items, *self.rivals(one, rng.choice(COUNTS))]
            rng.shuffle(extra)
            yield self._case("set with rivals", one, self._joined(extra))
            yield self._case("set that lacks one", one, self._joined(items[1:]))
        if re.fullmatch(r"[\d,]+(\.\d+)?", reference):
            form = rng.choice(QUANTITIES)
            if not _is_asked(form, one.instruction) and reference != "0":
                yield self._case("unit or sign", one, form.format(r=reference))

    def _named(self, one: Known, candidates: list[str]) -> Iterator[Case]:
        """Cases whose task names the other candidates and not the reference."""
        rivals, rng = ", ".join(item for item in candidates if item != one.reference), self._rng
        for form in ("Other than {}: ", "Unlike {}, ", "Start at the page on {}. "):
            asked = Known(one.source, form.format(rivals) + one.instruction, one.reference)
            told = "".join(rng.choice(EACH).format(item) for item in candidates)
            yield self._case("rivals that the task names", asked, told)
            told = rng.choice([sign for sign in SEPARATORS if not re.search(r"\w", sign)]).join(candidates)
            yield self._case("rivals that the task names", asked, told)

    def _choices(self, one: Known, candidates: list[str]) -> Iterator[Case]:
        """Cases whose task names the reference among other candidates."""
        listed = ", ".join(candidates[:-1]) + " or " + candidates[-1]
        rng = self._rng
        for task in (f"Which is right: {listed}?", f"{one.instruction} Choose among {listed}."):
            asked = Known(one.source, task, one.reference)
            yield self._case("choice that the task names", asked, self._joined(candidates))
            told = [rng.choice(EACH).format(item) for item in candidates]
            yield self._case("choice that the task names", asked, "".join(told))
            quote = rng.choice(("{}", "You asked: {}", "The question is: {}", "Task: {}", "> {}"))
            yield self._case("quote of the task", asked, quote.format(task.replace("?", rng.choice("?. "))))

    def right(self, one: Known, most: int | None = None) -> Iterator[Case]:
        """The reference in every plain wrapping, or in ``most`` random ones."""
        for form in WRAPPINGS if most is None else self._rng.sample(WRAPPINGS, most):
            text = one.reference
            count = form.replace("{{", "").count("{}")
            yield Case("wrapping", one.instruction, text, form.format(*[text] * count), True)
        yield Case("wrapping", one.instruction, one.reference, one.reference.lower(), True)
        yield Case("wrapping", one.instruction, one.reference, one.reference.replace(" ", "  "), True)

    def rivals(self, one: Known, count: int) -> list[str]:
        """Other answers of the same shape, or of any shape if there are none."""
        pool = self._pools[one.source, _shape(one.reference)]
        found: list[str] = []
        for attempt in range(count * 8):
            if len(found) == count:
                break
            rival = self._rng.choice(pool if attempt < count * 5 else self._all)
            if not _overlaps(rival, one.reference) and not any(
                compare(item, rival).match is Match.SAME for item in one.reference.split("; ")
            ):
                found.append(rival)
        return found or ["Zanzibar"]

    def _joined(self, candidates: Sequence[str]) -> str:
        rng = self._rng
        opening, closing = rng.choice(BRACKETS)
        separator, change = rng.choice(SEPARATORS), rng.choice(SHOUT)
        text = separator.join(f"{opening}{item}{closing}" for item in candidates)
        return change(rng.choice(WHOLE).format(text))

    @staticmethod
    def _case(family: str, one: Known, answer: str) -> Case:
        return Case(family, one.instruction, one.reference, answer, False)


def _is_asked(form: str, instruction: str) -> bool:
    """Whether the task asks for the unit that a form adds, so that the answer is right."""
    signs = {"km": "kilomet", "$": "dollar", "€": "euro", "%": "percent", "°": "degree", "¢": "cent"}
    names = [*re.findall("[a-z]{2,}", form), *(name for sign, name in signs.items() if sign in form)]
    return any(name.removesuffix("s") in instruction.casefold() for name in names)


def _shape(reference: str) -> str:
    """The rough kind of an answer."""
    if ";" in reference:
        return "list"
    if re.search(r"\d", reference):
        return "number" if re.fullmatch(r"[\d.,]+", reference) else "value"
    return "word" if " " not in reference else "words"


def _overlaps(one: str, other: str) -> bool:
    """Whether one of two answers contains the other."""
    a, b = ({*re.findall(r"\w+", text.casefold())} for text in (one, other))
    return not a or not b or a <= b or b <= a or one.casefold() in other.casefold()


def offline_references(every: int = 1) -> list[Known]:
    """All distinct references of the offline web, or of every n-th of its websites."""
    web = OfflineWeb()
    tasks = (task for host in list(web.specs)[::every] for task in web.tasks_of(host))
    found = {task.reference_answer: task.instruction for task in tasks if task.reference_answer}
    return [Known("offline", told, reference) for reference, told in found.items() if reference]


def source_references(data: Path) -> list[Known]:
    """The reference and example answers in the files of the benchmarks."""
    found: list[Known] = []
    for source, folder in FOLDERS.items():
        try:
            tasks = read_source(source, data / folder, today=date(2026, 1, 1)).tasks
        except (WebGymError, OSError) as error:
            print(f"{source}: {error}")
            continue
        answers = [(task.instruction, task.reference_answer or task.example_answer) for task in tasks]
        found += [Known(source, told, answer) for told, answer in answers if answer]
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder of source files")
    parser.add_argument("--per-reference", type=int, default=1, help="number of rounds of wrong answers")
    parser.add_argument("--wrong", type=int, default=8, help="number of wrong answers drawn per round")
    parser.add_argument(
        "--wrappings", type=int, default=16, help="number of right answers drawn per reference"
    )
    parser.add_argument(
        "--offline", type=int, help="maximum number of references of the offline web; by default all"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--show", type=int, default=0, help="number of false passes and fails to print per family"
    )
    args = parser.parse_args()
    offline = offline_references()
    random.Random(args.seed).shuffle(offline)
    known = [*source_references(args.data), *offline[: args.offline]]
    families = Families(known, args.seed)
    wrong: Counter[tuple[str, Match]] = Counter()
    right: Counter[tuple[str, Match]] = Counter()
    for one in known:
        for _ in range(args.per_reference):
            for case in draw(families.wrong(one), args.wrong, wrong.total()):
                _count(wrong, case.family, case, Match.SAME, args.show)
        for case in families.right(one, args.wrappings):
            _count(right, one.source, case, Match.DIFFERENT, args.show)
    print(f"{len(known)} references")
    _print_table("wrong answers", wrong)
    _print_table("right answers", right)


def _count(counts: Counter[tuple[str, Match]], row: str, case: Case, false: Match, show: int) -> None:
    """Count a case, and print it if it is one of the first that are decided falsely."""
    counts[row, case.match] += 1
    if case.match is false and counts[row, false] <= show:
        print(f"false {false} ({row}): {case.reference!r} <- {case.answer[:200]!r}")


def _print_table(title: str, counts: Counter[tuple[str, Match]]) -> None:
    """Print how often the rule says what, by row; unsure ones are left to a model."""
    print(f"\n{title:30} {'cases':>9} {'same':>8} {'different':>10} {'unsure':>8}")
    for row in [*sorted({row for row, _ in counts}), "all"]:
        same, different, unsure = (
            sum(
                number for (name, match), number in counts.items() if match is wanted and row in (name, "all")
            )
            for wanted in (Match.SAME, Match.DIFFERENT, Match.UNSURE)
        )
        count = same + different + unsure
        print(f"{row:30} {count:9,} {same:8,} {different:10,} {unsure / count:8.1%}")


if __name__ == "__main__":
    main()
