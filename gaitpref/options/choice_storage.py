"""The file of a reward of choices, beside the policy that was trained on it."""

from __future__ import annotations

import json
import math
from pathlib import Path

from data.episodes.choices import NAME
from data.errors import GaitprefError
from data.files.files import read_json, write_atomically
from data.files.plain import from_plain, to_plain
from policy.options.choice_row import ChoiceReward, choice_names

REWARD_NAME = "reward.json"


def save_choices(reward: ChoiceReward, directory: Path) -> None:
    """Write `reward` into `directory`, which is made if it is not there."""
    directory.mkdir(parents=True, exist_ok=True)
    text = json.dumps(to_plain(reward), indent=1)
    write_atomically(directory / REWARD_NAME, text.encode())


def load_choices(directory: Path) -> ChoiceReward:
    """Read what `save_choices` wrote.

    Raises:
        GaitprefError: it is damaged.
        OSError: it is missing.
    """
    path = directory / REWARD_NAME
    values = read_json(path)
    try:
        reward = from_plain(ChoiceReward, values)
        _require_sound(reward)
    except (TypeError, ValueError, AttributeError) as error:
        raise GaitprefError(
            f"{path} holds no reward of choices ({str(error)[:200]}); `gaitpref "
            "options` writes one beside its policy"
        ) from None
    return reward


def _require_sound(reward: ChoiceReward) -> None:
    gaits = gaits_of(reward)
    if not all(map(NAME.fullmatch, gaits)) or reward.names != choice_names(gaits):
        raise ValueError("its columns are none of a choice")
    count = len(reward.names)
    if len(reward.linear) != count or len(reward.square) not in (0, count):
        raise ValueError(f"{len(reward.linear)} weights for {count} columns")
    if not all(map(math.isfinite, (*reward.linear, *reward.square, reward.shift))):
        raise ValueError("a weight is no finite number")
    rate = reward.control_dt_s
    if not (math.isfinite(rate) and (rate > 0 if reward.robot else rate == 0)):
        raise ValueError(f"a control step of {rate} s of {reward.robot or 'no robot'}")


def gaits_of(reward: ChoiceReward) -> tuple[str, ...]:
    """The gaits that a reward of choices knows."""
    places = (name.partition(":") for name in reward.names)
    return tuple(dict.fromkeys(gait for gait, colon, _ in places if colon))
