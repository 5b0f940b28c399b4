"""Options of judges, shared by ``judge``, ``rollout`` and ``eval``."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from webgym.core.errors import ConfigError
from webgym.judge.config import STAGES, JudgeChoice
from webgym.settings import merged, read_yaml, validated

JUDGE_KEY = "WEBGYM_JUDGE_API_KEY"
"""Where a judge's key is looked for first; else where a policy's is."""


def judge_choice(
    given: Mapping[str, Any], *, file: Path | None = None, default: JudgeChoice | None = None
) -> JudgeChoice:
    """A judge from a file of settings and from options, which override it; an endpoint means a rubric judge.

    Args:
        given: what options say, in the shape of :class:`webgym.judge.config.JudgeChoice`. A stage for which
            only a model is given has the judge's endpoint.
        file: YAML in the same shape.
        default: what holds where nothing is given.

    Raises:
        ConfigError: something is missing or malformed.
    """
    held = (
        read_yaml(file, hint="see docs/judge.md")
        if file
        else (default or JudgeChoice()).model_dump(mode="json", exclude_none=True)
    )
    rubric = given.get("rubric") or {}
    has_endpoint = "base_url" in rubric.get("chat", {})
    name = given.get("name") or ("rubric" if has_endpoint else held.get("name"))
    if name == "rubric":
        held["rubric"] = merged(held.get("rubric") or {}, rubric)
        chat = held["rubric"].setdefault("chat", {})
        if not {"base_url", "model"} <= chat.keys():
            raise ConfigError(
                "the rubric judge needs an endpoint and a model", hint="give its base URL and its model"
            )
        if os.environ.get(JUDGE_KEY):
            chat.setdefault("api_key_env", JUDGE_KEY)
        for stage in STAGES:
            if stage in rubric:
                held["rubric"][stage]["chat"] = chat | rubric[stage]["chat"]
    elif has_endpoint:
        raise ConfigError(f"the judge {name} has no endpoint", hint="leave the base URL out")
    others = {key: each for key, each in given.items() if key not in ("name", "rubric")}
    held = merged(held, others | ({"name": name} if name else {}))
    return validated(JudgeChoice, held, str(file or "judge options"))


def own_choice(config: Mapping[str, Any]) -> JudgeChoice:
    """The judge that a run was collected with, by its ``config.yaml``; the offline one if it names none."""
    return validated(JudgeChoice, config.get("judge") or {}, "config.yaml: judge", hint="give --judge")
