"""Options of judges, shared by ``judge``, ``rollout`` and ``eval``."""

from __future__ import annotations

import os
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

from webgym.core.errors import ConfigError
from webgym.core.settings import merged, read_yaml, validated
from webgym.judge.config import MODEL_JUDGES, STAGES, JudgeChoice

JUDGE_KEY = "WEBGYM_JUDGE_API_KEY"
"""Environment variable of the judge's API key; if it is not set, the policy's variable is used."""

_POLICY_KEY = "WEBGYM_API_KEY"


def judge_choice(
    given: Mapping[str, Any], *, file: Path | None = None, default: JudgeChoice | None = None
) -> JudgeChoice:
    """A judge's settings, from a file and from options that override it.

    An endpoint without a judge's name selects the rubric judge, unless the settings name another that asks a
    model.

    Args:
        given: values of options, nested like :class:`webgym.judge.config.JudgeChoice`. A stage for which
            only a model is given uses the judge's endpoint.
        file: YAML file of the same settings.
        default: the settings that apply if there is no file.

    Raises:
        ConfigError: the file cannot be read, or a setting is missing or invalid.
    """
    settings = (
        read_yaml(file, hint="see docs/judge.md")
        if file
        else (default or JudgeChoice()).model_dump(mode="json", exclude_none=True)
    )
    rubric = given.get("rubric") or {}
    has_endpoint = "base_url" in rubric.get("chat", {})
    name = given.get("name") or settings.get("name")
    if has_endpoint and not given.get("name") and name not in MODEL_JUDGES:
        name = "rubric"
    if name in MODEL_JUDGES:
        settings["rubric"] = deepcopy(merged(settings.get("rubric") or {}, rubric))
        chat = settings["rubric"].setdefault("chat", {})
        if not {"base_url", "model"} <= chat.keys():
            raise ConfigError(
                f"the {name} judge needs an endpoint and a model", hint="set its base URL and its model"
            )
        for stage in STAGES:
            if stage in rubric:
                settings["rubric"][stage]["chat"] = chat | rubric[stage]["chat"]
        _choose_key(settings["rubric"], (None,) if file else (None, JUDGE_KEY, _POLICY_KEY))
    elif has_endpoint:
        raise ConfigError(f"the judge {name} uses no endpoint", hint="leave out the base URL")
    others = {key: value for key, value in given.items() if key not in ("name", "rubric")}
    settings = merged(settings, others | ({"name": name} if name else {}))
    return validated(JudgeChoice, settings, str(file or "judge options"))


def _choose_key(rubric: dict[str, Any], instead_of: tuple[str | None, ...]) -> None:
    """Choose between the judge's and the policy's variable by what is set now, for every endpoint.

    The settings of a stored run name one of them even if nobody chose it.
    """
    key = JUDGE_KEY if os.environ.get(JUDGE_KEY) else _POLICY_KEY
    for section in (rubric, *rubric.values()):
        chat = section.get("chat") if isinstance(section, dict) else None
        if isinstance(chat, dict) and chat.get("api_key_env") in instead_of:
            chat["api_key_env"] = key


def own_choice(config: Mapping[str, Any]) -> JudgeChoice:
    """The judge that a run's ``config.yaml`` names; the offline judge if it names none."""
    return validated(JudgeChoice, config.get("judge") or {}, "config.yaml: judge", hint="give --judge")
