"""Settings of a build: sources, models, limits."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

from pydantic import Field, ValidationError, field_validator

from webgym.core.errors import ConfigError
from webgym.llm.config import ChatConfig, Sampling
from webgym.llm.ledger import Budget
from webgym.llm.prices import Price
from webgym.settings import Section, Settings, first_problem, merged, read_yaml, without_none
from webgym.tasks.decompose import Decomposing
from webgym.tasks.duplicates import DuplicateLimits
from webgym.tasks.rewriting import WritingLimits
from webgym.tasks.sources import SOURCES
from webgym.tasks.split import SplitConfig

Purpose: TypeAlias = Literal["website", "rubric", "rewriting"]
PURPOSES: Final[tuple[Purpose, ...]] = ("website", "rubric", "rewriting")
"""What models are asked for, in the order of the stages."""


class SourceChoice(Settings):
    """One source of tasks."""

    path: str
    """A file, a folder, or ``hub:<datasets id>``."""

    at_most: int | None = Field(default=None, ge=1)
    """Take so many of its tasks, drawn by the seed before anything is asked; all if not given. A larger
    number takes the same ones and more, so that what a trial run has paid for serves the whole."""


class ModelChoice(Settings):
    """A model for one purpose, where it is not the build's own. What is not given stays as it is there."""

    base_url: str | None = None
    """Another endpoint."""

    model: str | None = None
    """Another model."""

    api_key_env: str | None = None
    """Environment variable of that endpoint's key."""

    sampling: Sampling = Sampling()
    """Other sampling parameters."""


class Assumptions(Section):
    """What an estimate takes for granted until the cache holds enough replies to measure it."""

    measured_from: int = Field(default=30, ge=1)
    """Finished things of a purpose from which on what is known of them replaces the numbers below."""

    asked_again: float = Field(default=0.1, ge=0)
    """Calls beyond the first per thing: replies that are refused and asked for again."""

    reply_tokens: Mapping[Purpose, int] = {"website": 40, "rubric": 250, "rewriting": 80}
    """Tokens of a reply. A model that thinks writes many more: measure it with a small run."""

    derived_per_task: float = Field(default=0.1, ge=0)
    """Tasks that are derived from one, on average over those whose rubric is not there yet."""


class BuildConfig(Settings):
    """A build of a task set."""

    sources: dict[str, SourceChoice] = Field(min_length=1)
    """By the names of :data:`webgym.tasks.sources.SOURCES`. A plain path stands for itself."""

    model: ChatConfig | None = None
    """Endpoint and model for all purposes. Not needed where nothing has to be asked."""

    models: dict[Purpose, ModelChoice] = Field(default_factory=dict)
    """Other ones for some purposes: ``website``, ``rubric``, ``rewriting``."""

    prices: dict[str, Price] = Field(default_factory=dict)
    """Dollars per million tokens, by model; ``*`` stands for every other. None are known by themselves."""

    budget: Budget = Budget()
    """What may be spent, all runs into the same cache together."""

    seed: int = 0
    """Seed of every random choice: tasks of a source, caps, the split."""

    today: date | None = None
    """What lies before it is flagged as dated. The day of a build's first run if not given; later runs into
    the same folder keep it."""

    plaintext: tuple[str, ...] = ()
    """Encrypted source (``browsecomp``) whose plain text may be sent to the model and written. The tasks of
    encrypted sources that are not named are left out."""

    writing: WritingLimits = WritingLimits()
    """How often to ask, and what rewritten tasks may look like."""

    decomposing: Decomposing = Decomposing()
    """How many tasks may be derived from one."""

    duplicates: DuplicateLimits = DuplicateLimits()
    """What counts as the same task, and how much the synthetic sources may bring."""

    split: SplitConfig = SplitConfig()
    """Size of the test set."""

    assumptions: Assumptions = Assumptions()
    """For ``--dry-run``."""

    figures: bool = True
    """Whether the figures of the statistics are drawn, which takes seconds."""

    endpoint_failures: int = Field(default=20, ge=1)
    """So many calls in a row that the endpoint fails, for whatever reason, end the build."""

    @field_validator("sources", mode="before")
    @classmethod
    def _plain_paths(cls, value: Any) -> Any:
        return _with_paths({"sources": value})["sources"]

    @field_validator("sources")
    @classmethod
    def _known(cls, value: dict[str, SourceChoice]) -> dict[str, SourceChoice]:
        unknown = value.keys() - SOURCES.keys()
        if unknown:
            raise ValueError(
                f"unknown source {', '.join(sorted(unknown))}; the sources are {', '.join(SOURCES)}"
            )
        return {name: value[name] for name in SOURCES if name in value}

    @field_validator("plaintext")
    @classmethod
    def _named(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if unknown := set(value) - SOURCES.keys():
            raise ValueError(f"unknown source {', '.join(sorted(unknown))}")
        return tuple(sorted(set(value)))

    def seeded(self) -> BuildConfig:
        """This config, with its seed in the parts that draw."""
        return self.model_copy(
            update={
                "duplicates": self.duplicates.model_copy(update={"seed": self.seed}),
                "split": self.split.model_copy(update={"seed": self.seed}),
            }
        )

    def chat(self, purpose: Purpose) -> ChatConfig | None:
        """Endpoint and model for a purpose; ``None`` if none is given."""
        choice = self.models.get(purpose, ModelChoice())
        changes = choice.model_dump(exclude_none=True, exclude={"sampling"})
        if self.model is not None:
            changes["sampling"] = choice.sampling.over(self.model.sampling)
            return ChatConfig.model_validate(self.model.model_dump() | changes)
        changes["sampling"] = choice.sampling
        if choice.base_url is None or choice.model is None:
            return None
        return ChatConfig.model_validate(changes)


def no_model(purpose: Purpose) -> ConfigError:
    """That something is to be asked, and there is nobody to ask."""
    return ConfigError(
        f"no model is given for the {purpose} stage",
        hint="give --base-url and --model, or `model:` in the config file",
    )


def _with_paths(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The same settings, with ``path:`` written out for every source that is given as its path alone."""
    sources = settings.get("sources")
    if not isinstance(sources, Mapping):
        return dict(settings)
    whole = {name: {"path": each} if isinstance(each, str) else each for name, each in sources.items()}
    return {**settings, "sources": whole}


def read_config(
    path: Path | None, overrides: Mapping[str, Any], *, at_most: int | None = None
) -> BuildConfig:
    """A build's config from a YAML file, some of it overridden; ``None`` overrides nothing.

    Args:
        path: of the file.
        overrides: in its shape.
        at_most: for every source that sets no smaller number.

    Raises:
        ConfigError: the file cannot be read, or a setting is missing, unknown or out of range.
    """
    held = read_yaml(path, hint="see configs/task-set.yaml for an example") if path is not None else {}
    # A source may stand as its path alone, over which no other key of it could be laid.
    told = merged(_with_paths(held), _with_paths(without_none(overrides)))
    try:
        config = BuildConfig.model_validate({key: each for key, each in told.items() if each != {}})
    except ValidationError as error:
        told = first_problem(error, BuildConfig)
        no_sources = told.startswith("sources: Field required")
        hint = "give --source NAME=PATH, or `sources:` in a config file" if no_sources else ""
        raise ConfigError(f"{path or 'options'}: {told}", hint=hint) from error
    if at_most is not None:
        limited = {
            name: choice.model_copy(update={"at_most": min(at_most, choice.at_most or at_most)})
            for name, choice in config.sources.items()
        }
        config = config.model_copy(update={"sources": limited})
    return config
