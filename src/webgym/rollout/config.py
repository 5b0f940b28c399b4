"""Settings of an attempt and of the collector."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import AfterValidator, Field

from webgym.core.identity import Identity, credentials_of
from webgym.core.settings import Settings
from webgym.core.storage import StorageState, read_storage
from webgym.core.task import StepBudget, Task
from webgym.core.websites import host_or_text
from webgym.rollout.sharing import SharingConfig


class Access(NamedTuple):
    """What a run signs in with.

    Attributes:
        credentials: ``NAME:PASSWORD`` by origin.
        storage: what websites keep in the browser, by website or task.
    """

    credentials: dict[str, str]
    storage: dict[str, StorageState]

    def storage_of(self, task: Task) -> StorageState:
        """What the task's website keeps in the browser already."""
        host = host_or_text(task.website)
        names = (task.id, host, f"www.{host}")
        return next((self.storage[name] for name in names if name in self.storage), StorageState())


class AttemptConfig(Settings):
    """Budgets and limits of an attempt."""

    viewport: tuple[int, int] = (1280, 768)
    """Width and height, CSS pixels (paper §4); 192 x 128 for the offline web's small websites, unless set."""

    budget_easy: int = Field(default=15, ge=1)
    """Steps for a task of 1 to 3 facts (paper §5: 15, better 10, in training; 30 in testing)."""

    budget_medium: int = Field(default=30, ge=1)
    """Steps for a task of 4 to 6 facts (paper §5: 30, better 20, in training; 50 in testing)."""

    budget_hard: int = Field(default=45, ge=1)
    """Steps for a task of 7 facts and more (paper §5: 45, better 30, in training; 70 in testing)."""

    longest_seconds: float = Field(default=3600.0, gt=0)
    """Time limit of an attempt: replies, actions and observations, without waiting in queues. An attempt that
    exceeds it ends without a reward, as the environment's failure: the agent's own limit is its budget of
    steps."""

    identity: Identity = Field(default_factory=Identity)
    """What differs from the browser server's ``browser.identity``; a task's own fields go before it."""

    logins: dict[str, Annotated[Path, AfterValidator(Path.absolute)]] = Field(default_factory=dict)
    """Who is signed in where: a website's host, or a task's id, and the file with the log-in, of ``webgym
    login`` or of Playwright's storage state. A task's id goes before its website."""

    share_parts: bool = False
    """Attempts at one task load scripts, style sheets, pictures and fonts once that a website calls public
    (``Cache-Control``), in each process of the server. Every such request is paused for it."""

    record_cuts: bool = False
    """Record the lines of each page that are never fully visible, for checks of websites."""

    @cached_property
    def access(self) -> Access:
        """What the credentials and log-ins are, read once.

        Raises:
            ConfigError: a variable or a file is missing, or holds something else.
        """
        storage = {name: read_storage(path) for name, path in self.logins.items()}
        return Access(credentials_of(self.identity), storage)

    @property
    def budget(self) -> StepBudget:
        """The three budgets as one value."""
        return StepBudget(self.budget_easy, self.budget_medium, self.budget_hard)


class CollectorConfig(Settings):
    """How many at once, and when to give up."""

    sessions: int = Field(default=16, ge=1)
    """Browser sessions, and therefore attempts, at the same time."""

    sessions_per_website: int | None = Field(default=None, ge=1)
    """Most attempts of this run at the same time at one website of the web; others go first."""

    schedule: Literal["async", "step_barrier", "episode_barrier"] = "async"
    """``async``: attempts are independent. ``step_barrier`` and ``episode_barrier`` are the paper's baselines
    (§4).

    ``step_barrier``: the policy is asked for all sessions in one batch, and they act when its last reply has
    come. ``episode_barrier``: a group of sessions begins together, and the next group when its last has
    ended.
    """

    refills: bool = True
    """Step barrier: a session whose attempt ended starts the next one and joins again when it is ready.
    Otherwise the group is fixed: the next one begins when the longest attempt of this one has ended."""

    order: Literal["given", "hardest_first"] = "given"
    """Order of the tasks. ``hardest_first`` starts long attempts early, so that few are left at the end."""

    policy_calls: int = Field(default=256, ge=1)
    """Replies that are asked for at the same time (the paper has 80 sessions of inference, appendix F). The
    endpoint's own limit, ``policy.chat.concurrency``, counts too."""

    judges: int = Field(default=8, ge=1)
    """Episodes being judged at the same time."""

    backlog: int = Field(default=64, ge=0)
    """Episodes that may wait for a judge or for the disk. When as many do, browsers take no new task: memory
    stays bounded."""

    judge_seconds: float = Field(default=300.0, gt=0)
    """How long one verdict may take before the attempt counts as unjudged."""

    judge_again: int = Field(default=2, ge=0)
    """How often attempts without a verdict are judged again, at the end of the run and when it is resumed."""

    straggler_share: float = Field(default=0.95, gt=0, le=1)
    """Once this share of the samples is done and all others have begun, the rest get a grace period (paper
    §4)."""

    straggler_seconds: float = Field(default=120.0, ge=0)
    """The grace period. Then whoever has had as long as the slowest of that share needed is ended, and is
    recorded as cancelled by the collector, which is no failure of the agent's: it carries no reward."""

    server_patience_seconds: float = Field(default=60.0, ge=0)
    """How long a server that does not answer, has no free slot or starts no browser, or an offline web that
    does not answer, is waited for before the run stops. Waiting for a slot does not count while this run
    itself holds some."""

    server_retry_seconds: float = Field(default=0.5, gt=0)
    """First pause before a server is asked again; each further pause is twice as long, up to eight times. An
    attempt is made again no sooner than eight times this after the server last ended one."""

    give_up_after: int = Field(default=20, ge=1)
    """The run stops when so many attempts in a row failed because the policy's endpoint or the server did, or
    had no verdict: nothing is won by sending the rest after them. Of those that ran, or were being judged, at
    the first failure, only the first counts: one restart may end them all."""

    sharing: SharingConfig = SharingConfig()
    """One task list for several collectors (:mod:`webgym.rollout.sharing`)."""

    metric_seconds: float = Field(default=5.0, gt=0)
    """How often a line is added to ``metrics.jsonl``."""

    metrics_port: int | None = Field(default=None, ge=0, le=65535)
    """Port of the loopback address where Prometheus may read the same figures; 0 takes a free one."""

    @property
    def is_grouped(self) -> bool:
        """Whether attempts begin together, group by group."""
        return self.schedule == "episode_barrier" or (self.schedule == "step_barrier" and not self.refills)
