"""A check before a run: does the policy reply at all, in the requested format, and point by the right scale?

A wrong key, model name, chat template, prompt format or profile costs one request here; discovered during a
run, it costs hours of browser time, and ends in attempts without a reward or with one of 0.
"""

from __future__ import annotations

import hashlib
import io
from typing import Final

import msgspec
from PIL import Image, ImageDraw

from webgym.agent.agent import Agent
from webgym.agent.context import thinking_of
from webgym.agent.formats import parse_reply
from webgym.agent.parser import ParsedReply
from webgym.agent.profile import SCALES
from webgym.agent.profiles import all_profiles
from webgym.core.action import GRID, Answer, LeftClick, Target
from webgym.core.errors import ConfigError
from webgym.core.observation import Element, Observation
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.text import fold
from webgym.core.trajectory import Step

TRIES = 3
"""Largest number of replies to request until one contains an action: a model at temperature 1 may fail
occasionally."""

_BUTTON: Final = (0.86, 0.86, 0.98, 0.96)
"""Left, top, right and bottom of the button, as shares of the page: so far right and low that a point on a
0-1000 grid that is read as pixels misses it, and the other way round."""

_CODE: Final = "K7"


async def check_policy(agent: Agent, viewport: tuple[int, int]) -> None:
    """Request a reply to a synthetic page with one button.

    Args:
        agent: the agent, entered.
        viewport: width and height of the page, CSS pixels.

    Raises:
        PolicyError: there was no reply.
        ConfigError: none of the replies contains an action, or one points at the button by another scale than
            the agent's profile.
    """
    for number in range(TRIES):
        step = await _ask(agent, "Click the button Start.", "Start", viewport, number)
        _refuse_other_scale(agent, step, viewport)
        if step.action is not None:
            return
    doubt = agent.profile.unverified
    raise ConfigError(
        f"{agent.policy.name} replied {TRIES} times to a test page, never with a valid action; the last: "
        f"{step.parse_error}",
        hint="is it a chat model that sees pictures, and the right --profile? policy.check: false skips this"
        + (f" (not verified for {agent.profile.name}: {doubt})" if doubt else ""),
    )


async def answer_in_words(agent: Agent, viewport: tuple[int, int]) -> str:
    """Ask what stands on a synthetic page, for the value alone.

    Args:
        agent: the agent, entered.
        viewport: width and height of the page, CSS pixels.

    Returns:
        The answer, if it is more than the value; empty if it is not, or if there was none.

    Raises:
        PolicyError: there was no reply.
    """
    for number in range(TRIES):
        step = await _ask(
            agent, "Which code is on the button? Answer with the code alone.", _CODE, viewport, number
        )
        if isinstance(step.action, Answer):
            return "" if fold(step.action.text).strip(".") == fold(_CODE) else step.action.text
    return ""


async def _ask(agent: Agent, instruction: str, label: str, viewport: tuple[int, int], seed: int) -> Step:
    """The agent's first step at a task on a synthetic page with one button."""
    width, height = viewport
    left, top, right, bottom = _BUTTON
    box = (left * width, top * height, (right - left) * width, (bottom - top) * height)
    image = _page(viewport, box, label)
    seen = Observation(
        hashlib.sha256(image).hexdigest(),
        "https://example.com/",
        "Example",
        viewport,
        text=label,
        elements=(Element(1, "button", label, box),),
    )
    rubric = Rubric((FactGroup(1, "click", ("The button was clicked",)),))
    task = Task("preflight", instruction, seen.url, "Misc.", "Other", rubric, "offline")
    return await agent.begin(task, seed, 10).turn(seen, image, 0.0)


def _refuse_other_scale(agent: Agent, step: Step, viewport: tuple[int, int]) -> None:
    """Refuse a reply whose point misses the button as the profile reads it and hits it by another scale.

    Raises:
        ConfigError: it is such a reply.
    """
    profile = agent.profile
    sent = profile.picture_size(viewport, agent.config.image_max_side)
    if profile.mode != "coordinates" or _hits(agent, step, profile.screen(sent)):
        return
    for grid, scale in SCALES.items():
        other = msgspec.structs.replace(profile, grid=grid)
        if _hits(agent, step, other.screen(sent)):
            fitting = (each.name for each in all_profiles().values() if each.grid == grid)
            raise ConfigError(
                f"{agent.policy.name} points {scale}, and the profile {profile.name} reads its points "
                f"{SCALES[profile.grid]}",
                hint=f"use --profile {next(fitting, 'NAME')}, or a profile of your own with grid: {grid}; "
                "policy.check: false skips this",
            )


def _hits(agent: Agent, step: Step, screen: tuple[int, int]) -> bool:
    """Whether the reply clicks the button if the largest x and y of its points are these."""
    found = parse_reply(
        step.reply.text,
        "coordinates",
        agent.config.prompt_format,
        screen=screen,
        thinking=thinking_of(step.reply, agent.profile),
        space=agent.config.actions,
    )
    match found:
        case ParsedReply(action=LeftClick(target=Target(coordinate=(x, y)))):
            left, top, right, bottom = _BUTTON
            return left <= x / GRID <= right and top <= y / GRID <= bottom
    return False


def _page(size: tuple[int, int], box: tuple[float, float, float, float], label: str) -> bytes:
    picture = Image.new("RGB", size, "white")
    left, top, width, height = box
    draw = ImageDraw.Draw(picture)
    draw.rectangle((left, top, left + width, top + height), fill="#1a56db")
    draw.text((left + width / 2, top + height / 2), label, fill="white", anchor="mm", font_size=height / 3)
    out = io.BytesIO()
    picture.save(out, "PNG")
    return out.getvalue()
