"""The help page of an encyclopedia."""

from __future__ import annotations

from dataclasses import dataclass

from webgym.offline.seeds import stream


@dataclass(frozen=True)
class Topic:
    """A question on the help page.

    Attributes:
        ask: the clause of a task: ``"find out how to ..."``.
        fact: what is to be found, as a rubric says it.
        mark: the words in the answer that matter.
        right: spellings of them that a right answer may use.
    """

    question: str
    answer: str
    ask: str
    fact: str
    mark: str
    right: tuple[str, ...]


def topics(seed: int, host: str, entry: str) -> tuple[Topic, ...]:
    """The questions that belong to a seed, in their order."""
    rng = stream(seed, "help")
    box = f"{rng.choice(('new', 'drafts', 'proposals', 'editors'))}@{host}"
    keys = rng.choice(("Ctrl+Shift+P", "Ctrl+Alt+P", "Alt+Shift+K", "Ctrl+Shift+V"))
    edits, days = rng.randint(12, 60), rng.randint(11, 28)
    licence = rng.choice(("CC BY 4.0", "CC BY-SA 4.0", "CC0 1.0", "Open Picture Licence 2.1"))
    code = f"{rng.choice('ABCDEFGH')}-{rng.randint(11, 98)}"
    an = "an" if entry[0] in "aeiou" else "a"
    made = [
        Topic(
            f"How do I propose a new {entry}?",
            f"Write a draft with at least two sources and send it to {box}. You will hear from an editor.",
            f"find out how to propose a new {entry}",
            f"the instructions for proposing a new {entry} are found",
            box,
            (box,),
        ),
        Topic(
            f"How do I print {an} {entry}?",
            f"Open it and press {keys}. This gives a version without menus and pictures.",
            f"find out how to get the print version of {an} {entry}",
            f"the instructions for printing {an} {entry} are found",
            keys,
            (keys, keys.replace("+", " + "), keys.replace("+", "-")),
        ),
        Topic(
            "How do I become an editor?",
            f"After {edits} accepted corrections you may ask for an editor's account.",
            "find out how many accepted corrections one needs before asking for an editor's account",
            "the number of accepted corrections needed for an editor's account is found",
            f"{edits} accepted corrections",
            (str(edits),),
        ),
        Topic(
            "When will my correction be read?",
            f"Somebody reads every report within {days} working days.",
            "find out within how many working days reports of mistakes are read",
            "the time within which reports of mistakes are read is found",
            f"{days} working days",
            (str(days),),
        ),
        Topic(
            "May I use the pictures?",
            f"All pictures are published under {licence}. Please name us as the source.",
            "find out under which licence the pictures are published",
            "the licence of the pictures is found",
            licence,
            (licence,),
        ),
        Topic(
            "How do I borrow the printed volume?",
            f"Fill in form {code} at any library that is a member, and leave a deposit.",
            "find out which form one fills in to borrow the printed volume",
            "the form for borrowing the printed volume is found",
            f"form {code}",
            (code, code.replace("-", " ")),
        ),
    ]
    rng.shuffle(made)
    return tuple(made)
