"""What ``judge`` and ``rollout`` share: from options to a judge."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from webgym.core.errors import ConfigError
from webgym.judge.config import STAGES
from webgym.judge.factory import JudgeChoice
from webgym.settings import read_yaml, validated

JUDGE_KEY = "WEBGYM_JUDGE_API_KEY"
"""Where a judge's key is looked for first; else where a policy's is."""


def judge_choice(
    name: str | None,
    base_url: str | None,
    model: str | None,
    *,
    file: Path | None = None,
    stage_models: Mapping[str, str | None] | None = None,
    samples: int | None = None,
    early_exit: bool | None = None,
    without_rubric: bool | None = None,
    default: JudgeChoice | None = None,
) -> JudgeChoice:
    """A judge from a file of settings and from options, which override it; an endpoint means a rubric judge.

    Args:
        name: ``offline``, ``rubric`` or ``module:function``.
        base_url, model: of the rubric judge.
        file: YAML in the shape of :class:`webgym.judge.factory.JudgeChoice`.
        stage_models: models of single stages at the same endpoint.
        samples: of a panel.
        early_exit: of the rubric judge.
        without_rubric: judge the task as a whole.
        default: what holds where nothing is given.

    Raises:
        ConfigError: something is missing or malformed.
    """
    held = (
        read_yaml(file, hint="see docs/judge.md")
        if file
        else (default or JudgeChoice()).model_dump(mode="json", exclude_none=True)
    )
    if name or base_url:
        held["name"] = name or "rubric"
    if held.get("name") == "rubric":
        rubric = dict(held.get("rubric") or {})
        chat = dict(rubric.get("chat") or {})
        if base_url:
            chat["base_url"] = base_url
        if model:
            chat["model"] = model
        if "base_url" not in chat or "model" not in chat:
            raise ConfigError(
                "the rubric judge needs an endpoint and a model", hint="give its base URL and its model"
            )
        if os.environ.get(JUDGE_KEY):
            chat.setdefault("api_key_env", JUDGE_KEY)
        rubric["chat"] = chat
        for stage in STAGES:
            if stage_model := (stage_models or {}).get(stage):
                rubric[stage] = dict(rubric.get(stage) or {}) | {"chat": chat | {"model": stage_model}}
        if early_exit is not None:
            rubric["early_exit"] = early_exit
        held["rubric"] = rubric
    elif base_url:
        raise ConfigError(f"the judge {held['name']} has no endpoint", hint="leave the base URL out")
    if samples is not None:
        held["panel"] = dict(held.get("panel") or {}) | {"samples": samples}
    if without_rubric is not None:
        held["without_rubric"] = without_rubric
    return validated(JudgeChoice, held, str(file or "judge options"))


def own_choice(config: Mapping[str, Any]) -> JudgeChoice:
    """The judge that a run was collected with, by its ``config.yaml``; the offline one if it names none."""
    return validated(JudgeChoice, config.get("judge") or {}, "config.yaml: judge", hint="give --judge")
