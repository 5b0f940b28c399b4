"""Play a task of the offline web in BrowserGym, with its browser, observations and actions.

python webgym_in_browsergym.py
"""

from __future__ import annotations

from typing import Any, Literal

import gymnasium

from webgym.integrations.browsergym_tasks import register_tasks


def main(split: Literal["train", "test"] = "test", answer: str = "I do not know", **options: Any) -> float:
    """One episode; its reward. A model would be shown ``view["screenshot"]`` and ``view["goal"]``."""
    [name] = register_tasks("small", split=split, count=1)
    env = gymnasium.make(name, disable_env_checker=True, **options)
    try:
        view, _ = env.reset()
        print(view["goal"])
        env.step("scroll(0, 200)")
        view, reward, terminated, _, _ = env.step(f"send_msg_to_user({answer!r})")
        print(f"{view['url']}: reward {reward:g}, terminated {terminated}")
    finally:
        env.close()
    return float(reward)


if __name__ == "__main__":
    main()
