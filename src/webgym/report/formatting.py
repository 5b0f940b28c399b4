"""Formatting of numbers and names for people."""

from __future__ import annotations

_MEANINGS = {
    "success": "answered, and the judge accepted it",
    "failure": "answered, and the judge rejected it",
    "truncated": "the step budget was spent without an answer",
    "blocked": "the website blocked the agent",
    "environment_error": "the browser, the server or the website failed",
    "policy_error": "the policy or its endpoint failed",
    "judge_error": "the judge gave no verdict",
    "cancelled": "the run was stopped before it ended",
}


def outcome_name(outcome: str) -> str:
    """``"environment_error"`` as ``"Environment error"``."""
    return outcome.replace("_", " ").capitalize()


def outcome_meaning(outcome: str) -> str:
    """The meaning of an outcome, in a few words."""
    return _MEANINGS[outcome]


def percent(share: float | None) -> str:
    """A share as a percentage; a dash for ``None``."""
    return "–" if share is None else f"{share * 100:.1f}%"


def points(difference: float | None) -> str:
    """A difference of shares in percentage points; a dash for ``None``."""
    return "–" if difference is None else f"{difference * 100:+.1f} points".replace("-", "−")


def milliseconds(value: float | None) -> str:
    """A time in milliseconds or seconds, with its unit; a dash for ``None``."""
    if value is None:
        return "–"
    if value < 10:
        return f"{value:.1f} ms" if value % 1 else f"{value:.0f} ms"
    if value < 1_000:
        return f"{value:.0f} ms"
    seconds = value / 1_000
    return f"{seconds:.0f} s" if seconds >= 10 or seconds % 1 == 0 else f"{seconds:.2f} s"


def duration(seconds: float) -> str:
    """A time in seconds, minutes and hours, with its units."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


def number(value: float) -> str:
    """A number with thin spaces between thousands; with one decimal if it is below 100 and not an integer."""
    return f"{value:,.0f}".replace(",", " ") if value >= 100 or value == int(value) else f"{value:.1f}"
