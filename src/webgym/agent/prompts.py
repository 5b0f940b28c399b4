"""The system prompts, and the format of the replies that they ask for (paper §5, appendix E).

Two prompt formats, each in two modes. The tool's name, screen and arguments follow the computer-use
convention of Qwen3-VL; the wording is WebGym's own.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, get_args

from webgym.agent.computer_use import TOOL_NAME, keys_of, to_arguments
from webgym.agent.config import AgentConfig
from webgym.agent.image_sizing import Size
from webgym.core.action import (
    DIRECTIONS,
    GRID,
    MAX_WAY_POINTS,
    Action,
    Mode,
    Modifier,
    Space,
    actions_of,
    fields_of,
    tool_text,
)

_SCREEN: dict[Mode, str] = {
    "coordinates": "The screen is {0}x{1}, from (0, 0) at the top left to ({0}, {1}) at the bottom right.",
    "marks": "Every element that can be used carries a number on the screenshot; "
    "name an element by that number.",
}

_POINT: dict[str, Any] = {
    "type": "array",
    "items": {"type": "number", "minimum": 0},
    "minItems": 2,
    "maxItems": 2,
}
_NUMBER = {"type": "integer", "minimum": 0}
_NAMES = {"type": "array", "items": {"type": "string"}, "minItems": 1}
_ARGUMENT_SCHEMA: dict[str, dict[str, Any]] = {
    "start_coordinate": _POINT | {"description": "[x, y], the point to start from"},
    "coordinate": _POINT | {"description": "[x, y], the point to use"},
    "start_element": _NUMBER | {"description": "The number on the element to start from"},
    "element": _NUMBER | {"description": "The number on the element to use"},
    "path": {
        "type": "array",
        "items": _POINT,
        "maxItems": MAX_WAY_POINTS,
        "description": "[[x, y], ...], points to pass on the way",
    },
    "modifiers": _NAMES
    | {"items": {"type": "string", "enum": list(get_args(Modifier))}, "description": "Keys to hold"},
    "text": {"type": "string", "description": "What to type, or the final answer"},
    "enter": {"type": "boolean", "description": "Whether to press Enter afterwards, true by default"},
    "accept": {"type": "boolean", "description": "OK rather than Cancel, true by default"},
    "keys": _NAMES | {"description": 'Keys by name, as ["Control", "a"], ["ArrowDown"], ["Escape"]'},
    "direction": {"type": "string", "enum": [], "description": ""},
    "files": _NAMES | {"description": "Names of files of the task"},
    "time": {"type": "number", "minimum": 0, "description": "Seconds"},
    "url": {"type": "string", "description": "A full http or https address"},
}
"""Each description is completed with the actions that take the argument."""

_ROLE = """\
You carry out tasks on the web for a user. You see the browser as screenshots and act with one tool, one \
action at a time. After each action you are shown the page as it then is."""

_RULES = """\
# Rules
- One action per reply. Look at the latest screenshot before you choose it; earlier ones show the past.
- Act only on what you can see. If what you need is not there, scroll, search or go back.
- If the last action changed nothing, do not repeat it over and over: try another way.
- Close or accept cookie banners and pop-ups that are in the way.
- Do not try to solve a CAPTCHA or any other test for robots. Leave that page alone and navigate \
elsewhere.
- Do not log in, register or pay unless the task tells you to and gives you what you need for it.
- The answer must rest on what you saw on the pages. Give it once everything that the task asks for is \
done and seen. If it cannot be done, say so in the answer and why."""

_MEMORY_REPLY = """\
# Reply
Write these five parts in this order and nothing else:
Memory: a JSON object with what you will need later: facts seen on pages, choices made. Screenshots pass \
out of sight after a few steps and only the memory stays. Keep every earlier entry as it is and add new \
ones; never remove or change one.
Progress: a JSON object that gives every subtask of the task as "finished" or "not finished". You may \
refine the subtasks as you learn more.
Intention: the subtask that you work on now, named as in Progress.
Action: one sentence that says what you do now and on what.
<tool_call>
{{"name": "{tool}", "arguments": {{"action": ..., ...}}}}
</tool_call>"""

_OFFICIAL_REPLY = """\
# Reply
Write these two parts in this order and nothing else:
Action: one sentence that says what you do now and on what.
<tool_call>
{{"name": "{tool}", "arguments": {{"action": ..., ...}}}}
</tool_call>"""

_REPLIES = {"memory": _MEMORY_REPLY, "official": _OFFICIAL_REPLY}
_TARGETS: dict[tuple[Mode, Space], str] = {
    ("coordinates", "paper"): "the point `coordinate`",
    ("marks", "paper"): "the element with the number `element`",
    ("coordinates", "extended"): "the point `{0}coordinate`",
    ("marks", "extended"): "the element `{0}element`",
}
_UNNUMBERED = " A place that carries no number is named by `coordinate` instead. {0}"


def system_prompt(config: AgentConfig, mode: Mode = "coordinates", screen: Size = (GRID, GRID)) -> str:
    """The system message of every request in a standard format.

    Args:
        config: prompt format, actions and date.
        mode: how a target is named.
        screen: largest x and y of points.
    """
    today = config.today
    parts = [
        _ROLE if today is None else f"{_ROLE}\nToday is {today:%A}, {today.day} {today:%B %Y}.",
        f"# Tool\n<tools>\n{_declared(mode, screen, config.actions)}\n</tools>",
        _REPLIES[config.prompt_format].format(tool=TOOL_NAME),
        _RULES,
    ]
    return "\n\n".join(parts)


@lru_cache(maxsize=64)  # every request has it
def _declared(mode: Mode, screen: Size, space: Space) -> str:
    return json.dumps(tool_declaration(mode, screen, space))


def tool_declaration(mode: Mode, screen: Size = (GRID, GRID), space: Space = "paper") -> dict[str, Any]:
    """The ``computer_use`` tool as a JSON schema, in the form in which chat templates declare tools."""
    place = _TARGETS[mode, space]
    places = {"target": place.format(""), "start": place.format("start_")}
    lines = [
        f"* `{name}`: {tool_text(action, space).format(**places)}"
        for name, action in actions_of(space).items()
    ]
    described = f"Use a web browser by mouse and keyboard. {_SCREEN[mode].format(*screen)}"
    if mode == "marks" and space == "extended":
        described += _UNNUMBERED.format(_SCREEN["coordinates"].format(*screen))
    return {
        "type": "function",
        "function": {
            "name": TOOL_NAME,
            "description": described,
            "parameters": {
                "type": "object",
                "properties": {
                    "action": {
                        "type": "string",
                        "enum": list(actions_of(space)),
                        "description": "What to do:\n" + "\n".join(lines),
                    },
                    **_arguments(mode, screen, space),
                },
                "required": ["action"],
            },
        },
    }


def _arguments(mode: Mode, screen: Size, space: Space) -> dict[str, dict[str, Any]]:
    """Schema of the tool's arguments except ``action``: those that an action of the space has in this
    mode."""
    takers: dict[str, list[str]] = {}
    for name, action in actions_of(space).items():
        for field in fields_of(action, space):
            for key in keys_of(field, mode, space):
                takers.setdefault(key, []).append(name)
    arguments: dict[str, dict[str, Any]] = {}
    for key, argument in _ARGUMENT_SCHEMA.items():
        if key not in takers:
            continue
        described, joint = argument["description"], " and " if space == "paper" else ", "
        purpose = f"for {joint.join(takers[key])}."
        changes: dict[str, Any] = {}
        if key == "direction":
            changes["enum"] = list(DIRECTIONS[space])
        elif key.endswith("coordinate"):
            changes = _on_screen(argument, screen)
        elif key == "path":
            changes["items"] = argument["items"] | _on_screen(argument["items"], screen)
        changes["description"] = f"{described}: {purpose}" if described else purpose.capitalize()
        arguments[key] = argument | changes
    return arguments


def _on_screen(point: dict[str, Any], screen: Size) -> dict[str, Any]:
    """The part of a point's schema that limits its numbers to the screen."""
    return {"items": point["items"] | {"maximum": max(screen)}}


def write_sections(
    action: Action, *, description: str, stated: Mapping[str, Mapping[str, Any] | str], screen: Size
) -> str:
    """A reply in a standard format: the sections before the action, by their headings, and the call."""
    lines = [
        f"{heading}: {content if isinstance(content, str) else _json(content)}"
        for heading, content in stated.items()
    ]
    call = _json({"name": TOOL_NAME, "arguments": to_arguments(action, screen)})
    lines += [f"Action: {description}", f"<tool_call>\n{call}\n</tool_call>"]
    return "\n".join(lines)


def _json(value: Mapping[str, Any]) -> str:
    """JSON without ``<``, so that no string in it can be taken for a tag."""
    return json.dumps(value, ensure_ascii=False).replace("<", "\\u003c")


def in_one_line(text: str) -> str:
    """Text for a section of a reply; no tag can open in it."""
    return " ".join(text.replace("<", "‹").split())
