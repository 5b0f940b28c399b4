"""WebGym: a training environment for visual web agents (arXiv 2601.02439).

The names below are what other code may rely on; everything else may move.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from webgym.core.timeouts import correct_timeouts

if TYPE_CHECKING:
    from webgym.agent.agent import Agent
    from webgym.agent.config import AgentConfig
    from webgym.agent.formats import render_reply
    from webgym.agent.policy import BasePolicy, Policy, PolicyInput, PolicySession
    from webgym.core.action import Action, Answer, GoBack, LeftClick, Navigate, Scroll, Target, Type, Wait
    from webgym.core.errors import UsageError, WebGymError
    from webgym.core.observation import Observation
    from webgym.core.outcome import Outcome
    from webgym.core.task import FactGroup, Rubric, Task
    from webgym.core.text import visible
    from webgym.core.trajectory import Episode, Reply, Step, Trajectory
    from webgym.core.verdict import Verdict
    from webgym.env.environment import Environment, make, random_action
    from webgym.env.pool import EnvironmentPool, make_many, task_rows
    from webgym.env.sync import LoopThread, SyncEnvironment
    from webgym.env.tokens import Sampled, TokenRequest, TokenRollout, TokenRow, roll_out
    from webgym.inference.rendering import Renderer
    from webgym.judge.base import Judge
    from webgym.judge.offline import OfflineJudge
    from webgym.offline.web import OfflineWeb
    from webgym.report.write import write_report
    from webgym.run.collect import collect, resume
    from webgym.run.config import RunConfig, TaskChoice
    from webgym.server.client import BrowserClient
    from webgym.server.config import ServerConfig
    from webgym.server.messages import View
    from webgym.server.worker import running_server
    from webgym.store.runs import RunReader
    from webgym.tasks.formats import read_tasks, write_tasks

__version__ = "0.1.0"

correct_timeouts()

_HOMES = {
    "webgym.agent.agent": "Agent",
    "webgym.agent.config": "AgentConfig",
    "webgym.agent.policy": "BasePolicy PolicySession Policy PolicyInput",
    "webgym.agent.formats": "render_reply",
    "webgym.run.config": "RunConfig TaskChoice",
    "webgym.run.collect": "collect resume",
    "webgym.core.action": "Action Answer GoBack LeftClick Navigate Scroll Target Type Wait",
    "webgym.core.errors": "UsageError WebGymError",
    "webgym.core.observation": "Observation",
    "webgym.core.outcome": "Outcome",
    "webgym.core.task": "FactGroup Rubric Task",
    "webgym.core.text": "visible",
    "webgym.core.trajectory": "Episode Reply Step Trajectory",
    "webgym.core.verdict": "Verdict",
    "webgym.env.environment": "Environment make random_action",
    "webgym.env.pool": "EnvironmentPool make_many task_rows",
    "webgym.inference.rendering": "Renderer",
    "webgym.judge.base": "Judge",
    "webgym.judge.offline": "OfflineJudge",
    "webgym.offline.web": "OfflineWeb",
    "webgym.report.write": "write_report",
    "webgym.store.runs": "RunReader",
    "webgym.server.client": "BrowserClient",
    "webgym.server.config": "ServerConfig",
    "webgym.server.messages": "View",
    "webgym.server.worker": "running_server",
    "webgym.env.sync": "LoopThread SyncEnvironment",
    "webgym.tasks.formats": "read_tasks write_tasks",
    "webgym.env.tokens": "Sampled TokenRequest TokenRollout TokenRow roll_out",
}
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names.split()}

__all__ = [
    "Action",
    "Agent",
    "AgentConfig",
    "Answer",
    "BasePolicy",
    "BrowserClient",
    "Environment",
    "EnvironmentPool",
    "Episode",
    "FactGroup",
    "GoBack",
    "Judge",
    "LeftClick",
    "LoopThread",
    "Navigate",
    "Observation",
    "OfflineJudge",
    "OfflineWeb",
    "Outcome",
    "Policy",
    "PolicyInput",
    "PolicySession",
    "Renderer",
    "Reply",
    "Rubric",
    "RunConfig",
    "RunReader",
    "Sampled",
    "Scroll",
    "ServerConfig",
    "Step",
    "SyncEnvironment",
    "Target",
    "Task",
    "TaskChoice",
    "TokenRequest",
    "TokenRollout",
    "TokenRow",
    "Trajectory",
    "Type",
    "UsageError",
    "Verdict",
    "View",
    "Wait",
    "WebGymError",
    "__version__",
    "collect",
    "make",
    "make_many",
    "random_action",
    "read_tasks",
    "render_reply",
    "resume",
    "roll_out",
    "running_server",
    "task_rows",
    "visible",
    "write_report",
    "write_tasks",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: ``import webgym`` and the command line stay quick."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
