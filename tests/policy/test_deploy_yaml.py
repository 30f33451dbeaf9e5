"""What `params/deploy.yaml` says of the observation, beside its terms."""

from __future__ import annotations

from pathlib import Path

import pytest

from policy.imported.meaning.deploy_yaml import read_deploy
from policy.law.law import LawError
from tests.helpers.foreign_layouts import deploy_yaml


def _told(path: Path, **observations: object) -> Path:
    path.write_text(deploy_yaml(observations=observations))
    return path


def test_its_switches_are_no_terms(tmp_path: Path) -> None:
    """Frames come together, oldest first; what is clipped after it was scaled by 0.25
    has bounds four times as wide before."""
    term = {"scale": [0.25] * 3, "clip": [-2.0, 3.0], "history_length": 5}
    switches = {"use_gym_history": True, "scale_first": True}
    path = tmp_path / "deploy.yaml"
    draft = read_deploy(_told(path, **switches, base_ang_vel=term))
    assert (draft.by_term, draft.newest_first) == (False, False)
    assert draft.terms is not None
    (found,) = draft.terms
    assert (found.name, found.frames, found.clip) == ("base_ang_vel", 5, (-8.0, 12.0))
    off = read_deploy(_told(path, scale_first=False, base_ang_vel=term))
    assert off.by_term
    assert off.terms is not None
    assert off.terms[0].clip == (-2.0, 3.0)
    with pytest.raises(LawError, match="use_gym_history must be true or false"):
        read_deploy(_told(path, use_gym_history=3, base_ang_vel=term))


def test_joint_pos_may_be_absolute(tmp_path: Path) -> None:
    """Who calls it joint_pos_rel has said it."""
    path = tmp_path / "deploy.yaml"
    assert "joint_pos" in read_deploy(_told(path, joint_pos={})).guessed
    assert "joint_pos" not in read_deploy(_told(path, joint_pos_rel={})).guessed
