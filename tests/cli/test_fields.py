"""Options that are made from the fields of settings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pytest
import typer
from pydantic import Field
from typer.testing import CliRunner

from webgym.cli._fields import Given, Option, Options, SettingsCommand, all_settings, takes
from webgym.core.settings import Settings


class Inner(Settings):
    """A section."""

    folder: Path | None = None
    """Where, with ``markup`` and :class:`a.Role`; [brackets] stay.

    Not in the help.
    """

    names: tuple[str, ...] = ()
    """Several."""


class Outer(Settings):
    """Settings."""

    count: int = Field(default=3, gt=0)
    """How many."""

    share: float = Field(default=0.5, ge=0, le=1)
    """Of all."""

    kind: Literal["a", "b"] | None = None
    """Which."""

    size: Annotated[int, Field(ge=1)] | Literal["all"] | None = None
    """Several types."""

    inner: Inner = Inner()


OPTIONS = Options(
    Outer,
    {
        "--count": "count",
        "--share": "share",
        "--kind/--no-kind": Option("kind", parse=lambda yes: "a" if yes else "b"),
        "--size": "size",
        "--folder": "inner.folder",
        "--name": "inner.names",
    },
)


def call(*arguments: str) -> tuple[int, str, Given]:
    """Exit code, output, and what the command was given."""
    received: Given = {}
    app = typer.Typer(rich_markup_mode="rich")

    @app.command(cls=SettingsCommand)
    @takes(outer=OPTIONS)
    def command(
        *,
        outer: Given,
        more: bool = typer.Option(False, "--more"),
        note: str = typer.Option("", "--note"),
    ) -> None:
        received.update(outer, more=more, **({"note": note} if note else {}))

    result = CliRunner().invoke(app, arguments, env={"COLUMNS": "200", "NO_COLOR": "1"})
    return result.exit_code, result.output, received


def test_only_what_was_given_is_passed_in_the_shape_of_the_model() -> None:
    assert call()[2] == {"more": False}
    given = call("--count", "2", "--no-kind", "--size", "all", "--name", "x", "--name", "y", "--more")[2]
    assert given == {"count": 2, "kind": "b", "size": "all", "inner": {"names": ["x", "y"]}, "more": True}


@pytest.mark.parametrize(
    ("words", "given"),
    [
        (("--inner.folder", "x"), {"inner": {"folder": "x"}}),
        (("--inner.folder=x=y", "--count", "2"), {"inner": {"folder": "x=y"}, "count": 2}),
        (("inner.names=[a, b]", "count=4"), {"inner": {"names": ["a", "b"]}, "count": "4"}),
        (("--set", "kind=null", "--count", "2", "count=3"), {"kind": None, "count": "3"}),
        (("--note", "count=3", "--more"), {"note": "count=3"}),
        (("--more", "nowhere.key=1"), {"nowhere": {"key": "1"}}),  # which validation refuses
    ],
)
def test_every_setting_is_set_by_its_path(words: tuple[str, ...], given: Given) -> None:
    assert call(*words)[2] == {"more": "--more" in words, **given}


def test_all_settings_are_listed_with_their_help() -> None:
    code, told, _ = call("--help-all")
    assert (code, told) == (0, "\n".join(all_settings(Outer)) + "\n")
    assert "count=3\n    How many.\n" in told
    assert "\ninner.names=\n    Several.\n" in told
    assert "\ninner=" not in told


@pytest.mark.parametrize(
    "wrong",
    ["--count 0", "--count x", "--share 1.5", "--inner.folder", "--set count", "count=[1", "--count"],
)
def test_values_that_a_field_does_not_take_are_refused(wrong: str) -> None:
    assert call(*wrong.split())[0] != 0


def test_help_is_the_first_paragraph_of_the_docstring_with_the_default() -> None:
    told = " ".join(call("--help")[1].split())
    assert "How many. [default: (3)]" in told
    assert "Where, with markup and a.Role; [brackets] stay." in told
    assert "Not in the help" not in told
