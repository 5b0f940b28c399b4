"""Settings of a build: sources, models, limits."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

from pydantic import Field, ValidationError, field_validator

from webgym.core.errors import ConfigError
from webgym.core.settings import Section, Settings, first_problem, merged, read_yaml, without_none
from webgym.llm.config import ChatConfig, Sampling
from webgym.llm.ledger import Budget
from webgym.llm.prices import Price
from webgym.tasks.sources import SOURCES
from webgym.tasks.split import SplitConfig
from webgym.taskset.decompose import DecompositionLimits
from webgym.taskset.duplicates import DuplicateLimits
from webgym.taskset.writing import DEFAULT_TRIES

Purpose: TypeAlias = Literal["website", "rubric", "rewriting", "critic"]
PURPOSES: Final[tuple[Purpose, ...]] = ("website", "rubric", "rewriting", "critic")
"""What models are used for, in the order of the stages."""


class SourceChoice(Settings):
    """One source of tasks."""

    path: str
    """A file, a folder, or ``hub:<datasets id>`` for a data set of the Hugging Face hub."""

    at_most: int | None = Field(default=None, ge=1)
    """Largest number of tasks, drawn by the seed before any model request; ``None`` takes all. A larger
    number takes the same tasks and more, so the replies of a trial run can be used for the whole build."""


class ModelChoice(Settings):
    """A model for one purpose, if it is not the build's ``model``. Fields that are not given are taken from
    that."""

    base_url: str | None = None
    """Base URL of its endpoint."""

    model: str | None = None
    """Name of the model."""

    api_key_env: str | None = None
    """Environment variable with the endpoint's API key."""

    sampling: Sampling = Sampling()
    """Sampling parameters that differ."""


class Writing(Settings):
    """How often a model is asked, and whether a second one checks what it writes."""

    tries: int = Field(default=DEFAULT_TRIES, ge=1)
    """Most requests for one website, rubric or text, until the reply is usable."""

    critic: bool = False
    """Whether a model, the critic, checks every rubric and every rewritten task by the rules of the prompts.
    What it finds is the reason to ask the writer again. This is one more request for each. Structure is
    checked without it."""


class Assumptions(Section):
    """Assumptions of a cost estimate, used until the cache has enough replies to measure the values."""

    reply_tokens: Mapping[Purpose, int] = {"website": 40, "rubric": 250, "rewriting": 80, "critic": 40}
    """Average tokens of a reply, by purpose. A thinking model writes many more: measure it with a small
    run."""


class BuildConfig(Settings):
    """A build of a task set."""

    sources: dict[str, SourceChoice] = Field(min_length=1)
    """Sources, by the names in :data:`webgym.tasks.sources.SOURCES`. A string is short for ``path:``."""

    model: ChatConfig | None = None
    """Endpoint and model for all purposes. Not needed if no model request is needed."""

    models: dict[Purpose, ModelChoice] = Field(default_factory=dict)
    """Endpoints and models of single purposes: ``website``, ``rubric``, ``rewriting``, ``critic``."""

    prices: dict[str, Price] = Field(default_factory=dict)
    """Dollars per million tokens, by model; ``*`` is the price of all other models. There are no built-in
    prices."""

    budget: Budget = Budget()
    """Most that may be spent, over all runs with the same cache."""

    seed: int = 0
    """Seed of every random choice: tasks of a source, caps, the split."""

    today: date | None = None
    """Date before which tasks are flagged as dated. Defaults to the day of the first run; later runs into the
    same folder keep it."""

    plaintext: tuple[str, ...] = ()
    """Encrypted sources (``browsecomp``) whose plain text may be sent to the model and written to files.
    Tasks of encrypted sources that are not listed are left out."""

    writing: Writing = Writing()
    """How often a model is asked, and whether a second one checks what it writes."""

    decomposing: DecompositionLimits = DecompositionLimits()
    """Limits on the number of tasks derived from one task."""

    duplicates: DuplicateLimits = DuplicateLimits()
    """What counts as a duplicate, and limits on the synthetic sources."""

    split: SplitConfig = SplitConfig()
    """Size and choice of the test set."""

    assumptions: Assumptions = Assumptions()
    """Assumptions of the estimate of ``--dry-run``."""

    figures: bool = True
    """Whether to draw the figures of the statistics, which takes seconds."""

    endpoint_failures: int = Field(default=20, ge=1)
    """Number of consecutive failed calls to the endpoint that ends the build."""

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
        """This config, with its seed copied into the sections that choose at random."""
        return self.model_copy(
            update={
                "duplicates": self.duplicates.model_copy(update={"seed": self.seed}),
                "split": self.split.model_copy(update={"seed": self.seed}),
            }
        )

    def chat(self, purpose: Purpose) -> ChatConfig | None:
        """Endpoint and model for a purpose; ``None`` if none is configured."""
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
    """The error for a stage that needs a model where none is configured."""
    return ConfigError(
        f"no model is given for the {purpose} stage",
        hint="give --base-url and --model, or `model:` in the config file",
    )


def _with_paths(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The same settings, with every source that is given as a string expanded to a mapping with ``path``."""
    sources = settings.get("sources")
    if not isinstance(sources, Mapping):
        return dict(settings)
    whole = {
        name: {"path": source} if isinstance(source, str) else source for name, source in sources.items()
    }
    return {**settings, "sources": whole}


def read_config(
    path: Path | None, overrides: Mapping[str, Any], *, at_most: int | None = None
) -> BuildConfig:
    """Read a build's config from a YAML file and apply overrides.

    Args:
        path: of the file; ``None`` starts from the defaults.
        overrides: values in the structure of the file; ``None`` values override nothing.
        at_most: largest number of tasks of every source; a source's own smaller number stays.

    Raises:
        ConfigError: the file cannot be read, or a setting is missing, unknown or out of range.
    """
    from_file = read_yaml(path, hint="see configs/task-set.yaml for an example") if path is not None else {}
    # A source given as a string is expanded first, so that its other keys can be merged in.
    settings = merged(_with_paths(from_file), _with_paths(without_none(overrides)))
    try:
        config = BuildConfig.model_validate({key: value for key, value in settings.items() if value != {}})
    except ValidationError as error:
        problem = first_problem(error, BuildConfig)
        no_sources = problem.startswith("sources: Field required")
        hint = "give --source NAME=PATH, or `sources:` in a config file" if no_sources else ""
        raise ConfigError(f"{path or 'options'}: {problem}", hint=hint) from error
    if at_most is not None:
        limited = {
            name: choice.model_copy(update={"at_most": min(at_most, choice.at_most or at_most)})
            for name, choice in config.sources.items()
        }
        config = config.model_copy(update={"sources": limited})
    return config
