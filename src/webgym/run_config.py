"""The settings of a run: which tasks, policy, judge and browsers, and every limit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field, SecretStr, model_validator

from webgym.agent.config import AgentConfig
from webgym.agent.policy import Policy
from webgym.agent.profile import Profile
from webgym.agent.profiles import choose_profile, profile_of
from webgym.browser.config import BrowserConfig
from webgym.core.errors import RunFolderError
from webgym.judge.config import JudgeChoice
from webgym.llm.config import ChatConfig
from webgym.offline.config import SitesConfig
from webgym.rollout.blocklist import BlocklistConfig
from webgym.rollout.config import AttemptConfig, CollectorConfig
from webgym.rollout.store import RunReader
from webgym.rollout.trackers import TrackerName
from webgym.server.config import ClientLimits, Queues
from webgym.settings import Settings, validated
from webgym.tasks.selection import Selection

FEW: Final = 20
"""Tasks of a run that does not say how many, unless somebody has put a file of no more than :data:`MANY`
together for it."""

MANY: Final = 100
"""Tasks that are attempted without being asked for by number."""


class TaskChoice(Selection):
    """Which tasks. Training tasks, unless ``split`` says otherwise."""

    file: Path | None = None
    """Task file of any format, or a folder of them; without one, the offline web's tasks."""

    count: Annotated[int, Field(ge=1)] | Literal["all"] | None = None
    """Number of tasks to draw at random without replacement, or ``all``.

    By default all of a file of up to 100, and 20 of a larger one and of the offline web, which has thousands.
    With a ``ratio``, which needs a count, a task is drawn again once all of its level have been drawn.
    """

    spread: bool = False
    """Draw from every website, all of a brand's being one, before drawing from one again: small samples
    then show all of them."""

    @model_validator(mode="after")
    def _check_count(self) -> TaskChoice:
        if self.ratio is not None and (not isinstance(self.count, int) or self.spread):
            raise ValueError("a ratio needs a count, and goes without spread")
        return self

    def drawn(self, there: int) -> int | None:
        """How many are drawn of those that are there; ``None`` for all.

        Args:
            there: tasks to draw from.
        """
        if self.count is None:
            return FEW if self.file is None or there > MANY else None
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
    """Ask for a reply before anything else starts: one of the openai policy, which must hold an action
    (:mod:`webgym.agent.preflight`), and one of every model of a rubric judge."""

    @model_validator(mode="before")
    @classmethod
    def _name(cls, given: Any) -> Any:
        if isinstance(given, Mapping) and given.get("chat") and not given.get("name"):
            return {**given, "name": "openai"}
        return given

    @model_validator(mode="after")
    def _is_whole(self) -> PolicyChoice:
        # Else an oracle's success would stand under a model's name.
        if self.chat is not None and self.name in ("scripted", "random"):
            raise ValueError(f"the {self.name} policy asks no model: leave chat out, or choose openai")
        return self


class ServerChoice(Settings):
    """Which browsers."""

    url: str | None = None
    """URL of a running browser server; without one, browsers are started here for the run."""

    queues: Queues = "per_operation"
    """Of a server that is started here: ``per_operation``, or ``global``, the paper's baseline."""

    sites_url: str | None = None
    """URL of a running offline web, whose token is in WEBGYM_SITES_TOKEN; without one it is served here if
    needed."""

    static: bool = False
    """No browsers (:mod:`webgym.static_browsers`): for studies on the small websites only."""

    pictures: Path = Path("runs/pictures")
    """Folder for the pages that are drawn where there are no browsers."""


class RunConfig(Settings):
    """A whole run, resolved; ``config.yaml`` in the run folder holds it. No secrets."""

    seed: int = 0
    """Seed of the order of tasks and of everything random in the attempts."""

    samples: int = Field(default=1, ge=1)
    """Attempts per task."""

    retries: int = Field(default=1, ge=0)
    """How often a sample is attempted again after an error of the environment or the policy."""

    tasks: TaskChoice = TaskChoice()
    policy: PolicyChoice = PolicyChoice()
    agent: AgentConfig = AgentConfig()
    judge: JudgeChoice = JudgeChoice()
    server: ServerChoice = ServerChoice()
    browser: BrowserConfig = BrowserConfig()
    sites: SitesConfig = SitesConfig()
    attempt: AttemptConfig = AttemptConfig()
    collector: CollectorConfig = CollectorConfig()
    blocklist: BlocklistConfig = BlocklistConfig()
    limits: ClientLimits = ClientLimits()

    trackers: tuple[TrackerName, ...] = ()
    """Who gets the figures of ``metrics.jsonl`` while the run goes on: ``tensorboard``, ``wandb``."""

    project: str = "webgym"
    """In Weights & Biases."""


class Secrets(Settings):
    """What a run needs and its folder must not hold."""

    server_token: SecretStr | None = None
    sites_token: SecretStr | None = None


Tell: TypeAlias = Callable[[str], None]
"""Is told, a line at a time, what a person should know."""


def resolved(config: RunConfig, policy: Policy | None, tell: Tell | None) -> RunConfig:
    """The config with what the model's profile and the websites decide, as the run folder holds it.

    Args:
        config: as it was given.
        policy: one of the caller's own, if there is one.
        tell: is told if no profile knows the model.

    Raises:
        ConfigError: the config names a profile that is not there.
    """
    from webgym.offline.web import COLLECTIONS  # costs what all families do; `--help` needs none of them

    profile = profile_for(config, policy)
    update: dict[str, Any] = {
        "agent": config.agent.model_copy(update={"profile": profile.name, "mode": profile.mode})
    }
    if "viewport" not in config.attempt.model_fields_set:
        viewport = COLLECTIONS[config.sites.collection].viewport
        update["attempt"] = config.attempt.model_copy(update={"viewport": viewport})
    chat = config.policy.chat
    if policy is None and chat is not None:
        if config.agent.profile is None and profile_of(chat.model) is None:
            unknown = f"no profile knows the model {chat.model}: the profile {profile.name} is used"
            say(tell, f"{unknown}; --profile chooses another")
        chat = chat.model_copy(update={"sampling": profile.sampling_of(chat.sampling)})
        update["policy"] = config.policy.model_copy(update={"chat": chat})
    return config.model_copy(update=update)


def profile_for(config: RunConfig, policy: Policy | None) -> Profile:
    """Of the policy's family of models.

    Raises:
        ConfigError: the config names a profile that is not there.
    """
    model = policy.name if policy else config.policy.chat.model if config.policy.chat else config.policy.name
    return choose_profile(config.agent.profile, model, config.agent.mode)


def read_config(reader: RunReader) -> tuple[RunConfig, str]:
    """A run's config and id, as its folder holds them.

    Raises:
        RunFolderError: ``config.yaml`` is not what a run of this version writes.
    """
    held = dict(reader.config)
    run_id = str(held.pop("run_id", ""))
    for stamp in (
        "started",
        "software",
        "skipped_records",
        "set_aside_tasks",
        "left_out_tasks",
        "merged_runs",
    ):
        held.pop(stamp, None)
    return validated(RunConfig, held, f"{reader.path}/config.yaml", failure=RunFolderError), run_id


def say(tell: Tell | None, line: str) -> None:
    """Pass a line on to whoever is told; to nobody if there is none."""
    if tell is not None:
        tell(line)
