"""The settings of a run: which tasks, policy, judge and browsers, and every limit."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field, SecretStr, model_validator

from webgym.agent.config import AgentConfig
from webgym.agent.policy import Policy
from webgym.agent.profile import Profile
from webgym.agent.profiles import choose_profile, profile_of
from webgym.browser.config import BrowserConfig
from webgym.core.consent import confirm
from webgym.core.errors import ConfigError, RunFolderError
from webgym.core.settings import Settings, set_values, validated
from webgym.judge.config import JudgeChoice
from webgym.llm.config import ChatConfig
from webgym.offline.config import SitesConfig, collection_of
from webgym.rollout.config import AttemptConfig, CollectorConfig
from webgym.rollout.site_health import HealthConfig
from webgym.rollout.trackers import TrackerName
from webgym.server.config import ClientLimits, Queues
from webgym.store.files import CONFIG
from webgym.store.runs import RunReader
from webgym.tasks.benchmarks import BENCHMARKS, BenchmarkName
from webgym.tasks.hub import address_of, pinned
from webgym.tasks.selection import Selection

SITES_TOKEN: Final = "WEBGYM_SITES_TOKEN"  # noqa: S105 - a variable's name

FEW: Final = 20
"""Number of tasks of a run that sets no count, unless its task file has at most :data:`MANY` tasks."""

MANY: Final = 100
"""Largest task file of which a run without a count attempts all tasks."""


class TaskChoice(Selection):
    """Which tasks; by default training tasks."""

    file: Path | None = None
    """Task file of any format, a folder of them, the name of tasks, such as ``offline-small-v2``, or a data
    set on the hub: ``hub:OWNER/NAME[@REVISION][:SPLIT]``; without one, the offline web's tasks."""

    benchmark: BenchmarkName | None = None
    """Benchmark whose public file ``file`` is, read as it is; its own judge decides unless another is
    named."""

    count: Annotated[int, Field(ge=1)] | Literal["all"] | None = None
    """Number of tasks to draw at random without replacement, or ``all``.

    By default all of a file of up to 100, and 20 of a larger one and of the offline web, which has thousands.
    With a ``ratio``, which needs a count, a task is drawn again once all of its level have been drawn.
    """

    spread: bool = False
    """Draw from every website once (a brand's websites count as one) before drawing from any again: small
    samples then cover all of them."""

    @model_validator(mode="after")
    def _check_count(self) -> TaskChoice:
        if self.ratio is not None and (not isinstance(self.count, int) or self.spread):
            raise ValueError("a ratio needs a count, and excludes spread")
        if self.benchmark is not None and self.file is None:
            raise ValueError(f"the benchmark {self.benchmark} needs its public file")
        return self

    def drawn(self, available: int) -> int | None:
        """Number of tasks to draw; ``None`` for all.

        Args:
            available: number of tasks to draw from.
        """
        if self.count is None:
            return FEW if self.file is None or available > MANY else None
        return None if self.count == "all" else self.count


class PolicyChoice(Settings):
    """Which policy."""

    name: str = "scripted"
    """``scripted`` (an oracle that plays known solutions), ``random`` or ``openai``. By default ``openai`` if
    an endpoint is given, else ``scripted``."""

    mistakes: float = Field(default=0.0, ge=0, le=1)
    """Scripted policy: share of attempts in which it makes a mistake."""

    chat: ChatConfig | None = None
    """Of the openai policy: endpoint and model."""

    check: bool = True
    """Request a test reply before anything else starts: from the openai policy, which must give an action
    (:mod:`webgym.agent.preflight`), and from every model of a rubric judge."""

    @model_validator(mode="before")
    @classmethod
    def _name(cls, given: Any) -> Any:
        if isinstance(given, Mapping) and given.get("chat") and not given.get("name"):
            return {**given, "name": "openai"}
        return given

    @model_validator(mode="after")
    def _check_chat(self) -> PolicyChoice:
        # Otherwise an oracle's success would be attributed to a model.
        if self.chat is not None and self.name in ("scripted", "random"):
            raise ValueError(f"the {self.name} policy uses no model: leave chat out, or choose openai")
        return self


class ServerChoice(Settings):
    """Which browsers."""

    url: str | None = None
    """URL of a running browser server; without one, browsers are started here for the run."""

    queues: Queues = "per_operation"
    """Queues of a server that is started here: ``per_operation``, or ``global``, the paper's baseline."""

    sites_url: str | None = None
    """URL of a running offline web, whose token is in WEBGYM_SITES_TOKEN; without one it is served here if
    needed. A running browser server needs the rules (``--allow-host``) that ``webgym sites serve`` prints."""

    static: bool = False
    """Use no browsers (:mod:`webgym.study.static_browsers`); for studies on the small websites only."""

    pictures: Path = Path("runs/pictures")
    """Folder for screenshots that are rendered for ``static``."""


class RunConfig(Settings):
    """The config of a run, stored in resolved form as ``config.yaml`` in the run folder. It holds no
    secrets."""

    seed: int = 0
    """Seed of the order of tasks and of all random choices in the attempts."""

    samples: int = Field(default=1, ge=1)
    """Attempts per task."""

    retries: int = Field(default=1, ge=0)
    """How often a sample is attempted again after an error of the environment or the policy."""

    tasks: TaskChoice = TaskChoice()
    """Which tasks, and how many."""

    policy: PolicyChoice = PolicyChoice()
    """Who acts."""

    agent: AgentConfig = AgentConfig()
    """How observations become requests and replies become actions."""

    judge: JudgeChoice = JudgeChoice()
    """Who decides about success."""

    server: ServerChoice = ServerChoice()
    """Which browsers, here or elsewhere."""

    browser: BrowserConfig = BrowserConfig()
    """How browsers that are started here behave."""

    sites: SitesConfig = SitesConfig()
    """The offline web: collection, seed, latency."""

    attempt: AttemptConfig = AttemptConfig()
    """Limits of an attempt."""

    collector: CollectorConfig = CollectorConfig()
    """How many attempts at once, and when the run gives up."""

    health: HealthConfig = HealthConfig()
    """Which websites refuse or are dead, and are left alone for now."""

    limits: ClientLimits = ClientLimits()
    """Limits of the client of the browser server."""

    trackers: tuple[TrackerName, ...] = ()
    """Trackers that get the figures of ``metrics.jsonl`` during the run: ``tensorboard``, ``wandb``."""

    project: str = "webgym"
    """Project name in Weights & Biases."""

    @model_validator(mode="before")
    @classmethod
    def _named_tasks(cls, given: Any) -> Any:
        """The websites of tasks that ``tasks.file`` names, in place of a file."""
        if not isinstance(given, Mapping):
            return given
        tasks, sites = set_values(given.get("tasks", {})), set_values(given.get("sites", {}))
        if not (isinstance(tasks, Mapping) and isinstance(sites, Mapping)):
            return given
        name = str(tasks.get("file"))
        if (collection := collection_of(name)) is None:
            return given
        if others := sorted({"collection", "seed", "per_family"} & sites.keys()):
            raise ValueError(f"the tasks {name} have their own websites: leave out sites.{others[0]}")
        named = {"tasks": {**tasks, "file": None}, "sites": {**sites, "collection": collection}}
        return {**given, **named}

    @model_validator(mode="before")
    @classmethod
    def _benchmark_judge(cls, given: Any) -> Any:
        """A benchmark's own judge, if no other is named."""
        if not isinstance(given, Mapping):
            return given
        tasks, judge = set_values(given.get("tasks", {})), set_values(given.get("judge", {}))
        if not (isinstance(tasks, Mapping) and isinstance(judge, Mapping)) or "name" in judge:
            return given
        own = BENCHMARKS.get(tasks.get("benchmark"))  # type: ignore[arg-type]  # checked by its field
        return given if own is None else {**given, "judge": {**judge, "name": own.judge}}


def _from_environment(variable: str) -> SecretStr | None:
    value = os.environ.get(variable)
    return SecretStr(value) if value else None


@dataclass(frozen=True)
class Secrets:
    """Secrets that a run needs, by default from the environment. They are no settings: no file holds them,
    and they are never stored in the run's folder.

    Attributes:
        server_token: of the browser server.
        sites_token: of the offline web.
    """

    server_token: SecretStr | None = field(default_factory=partial(_from_environment, "WEBGYM_TOKEN"))
    sites_token: SecretStr | None = field(default_factory=partial(_from_environment, SITES_TOKEN))


Tell: TypeAlias = Callable[[str], None]
"""Called with each line that the user should read, such as a warning."""


def viewport_of(config: RunConfig) -> tuple[int, int]:
    """The viewport's width and height, CSS pixels: if none is set, that of the websites."""
    from webgym.offline.web import COLLECTIONS  # costs what all families do; `--help` needs none of them

    is_set = "viewport" in config.attempt.model_fields_set
    return config.attempt.viewport if is_set else COLLECTIONS[config.sites.collection].viewport


def resolved(config: RunConfig, policy: Policy | None, tell: Tell | None) -> RunConfig:
    """The config with the values that the model's profile and the websites determine, as stored in the run.

    Args:
        config: as given.
        policy: the caller's own policy, if any.
        tell: called with a warning if no profile matches the model.

    Raises:
        ConfigError: the config names an unknown profile, or asks for several samples with one seed.
    """
    profile = profile_for(config, policy)
    update: dict[str, Any] = {
        "agent": config.agent.model_copy(update={"profile": profile.name, "mode": profile.mode})
    }
    update["attempt"] = config.attempt.model_copy(update={"viewport": viewport_of(config)})
    chat = config.policy.chat
    if chat is not None and config.samples > 1:
        extra = chat.sampling.extra_body
        if seeds := [name for name in ("seed", "sampling_seed") if extra.get(name) is not None]:
            raise ConfigError(
                f"with a fixed {seeds[0]} in policy.chat.sampling.extra_body, the {config.samples} samples of"
                " a task would be one sample",
                hint="leave it out, or set samples to 1",
            )
    if policy is None and chat is not None:
        if config.agent.profile is None and profile_of(chat.model) is None:
            warning = f"no profile knows the model {chat.model}: the profile {profile.name} is used"
            say(tell, f"{warning}; --profile chooses another")
        chat = chat.model_copy(update={"sampling": profile.sampling_of(chat.sampling)})
        update["policy"] = config.policy.model_copy(update={"chat": chat})
    return config.model_copy(update=update)


def with_pinned_tasks(config: RunConfig) -> RunConfig:
    """The config with the commit in the address of a data set on the hub, so that a run always has the same
    tasks.

    Raises:
        ConfigError, TaskFileError: as for :func:`webgym.tasks.hub.pinned`.
    """
    if config.tasks.file is None or address_of(config.tasks.file) is None:
        return config
    update = {"file": Path(pinned(config.tasks.file))}
    return config.model_copy(update={"tasks": config.tasks.model_copy(update=update)})


def profile_for(config: RunConfig, policy: Policy | None) -> Profile:
    """The profile of the policy's model family.

    Raises:
        ConfigError: the config names an unknown profile.
    """
    model = policy.name if policy else config.policy.chat.model if config.policy.chat else config.policy.name
    return choose_profile(config.agent.profile, model, config.agent.mode)


def read_config(reader: RunReader) -> tuple[RunConfig, str]:
    """A run's config and id, read from its folder.

    Raises:
        RunFolderError: ``config.yaml`` is not valid for this version.
        ConfigError: nobody has confirmed what it names (:mod:`webgym.core.consent`).
    """
    data = dict(reader.config)
    run_id = str(data.pop("run_id", ""))
    for stamp in (
        "started",
        "software",
        "skipped_records",
        "set_aside_tasks",
        "left_out_tasks",
        "merged_runs",
    ):
        data.pop(stamp, None)
    confirm(reader.config, reader.path / CONFIG)
    return validated(RunConfig, data, f"{reader.path}/config.yaml", failure=RunFolderError), run_id


def say(tell: Tell | None, line: str) -> None:
    """Call ``tell`` with a line; do nothing if it is ``None``."""
    if tell is not None:
        tell(line)
