"""A check before a run: does the policy reply at all, and in the requested format?

A wrong key, model name, chat template or prompt format costs one request here; discovered during a run, it
costs hours of browser time, and ends in attempts without a reward.
"""

from __future__ import annotations

import hashlib
import io

from PIL import Image, ImageDraw

from webgym.agent.agent import Agent
from webgym.core.errors import ConfigError
from webgym.core.observation import Element, Observation
from webgym.core.task import FactGroup, Rubric, Task

TRIES = 3
"""Largest number of replies to request until one contains an action: a model at temperature 1 may fail
occasionally."""

_BOX = (40.0, 40.0, 160.0, 48.0)


async def check_policy(agent: Agent, viewport: tuple[int, int]) -> None:
    """Request a reply to a synthetic page with one button.

    Args:
        agent: the agent, entered.
        viewport: width and height of the page, CSS pixels.

    Raises:
        PolicyError: there was no reply.
        ConfigError: none of the replies contains an action.
    """
    image = _page(viewport)
    button = Element(1, "button", "Start", _BOX)
    seen = Observation(
        hashlib.sha256(image).hexdigest(),
        "https://example.com/",
        "Example",
        viewport,
        text="Start",
        elements=(button,),
    )
    rubric = Rubric((FactGroup(1, "click", ("The button was clicked",)),))
    task = Task("preflight", "Click the button Start.", seen.url, "Misc.", "Other", rubric, "offline")
    for number in range(TRIES):
        step = await agent.begin(task, number, 10).turn(seen, image, 0.0)
        if step.action is not None:
            return
    raise ConfigError(
        f"{agent.policy.name} replied {TRIES} times to a test page, never with a valid action; the last: "
        f"{step.parse_error}",
        hint="is it a chat model that sees pictures, and the right --profile? policy.check: false skips this",
    )


def _page(size: tuple[int, int]) -> bytes:
    picture = Image.new("RGB", size, "white")
    left, top, width, height = _BOX
    draw = ImageDraw.Draw(picture)
    draw.rectangle((left, top, left + width, top + height), fill="#1a56db")
    draw.text((left + 62, top + 18), "Start", fill="white")
    out = io.BytesIO()
    picture.save(out, "PNG")
    return out.getvalue()
