"""Policies that others published, where their files lie beside the checkout."""

from __future__ import annotations

from pathlib import Path

import pytest

OTHERS = Path(__file__).resolve().parents[3] / "shared" / "others"
GO2 = OTHERS / "robots" / "unitree_go2" / "scene.xml"
ROBOT_LAB = OTHERS / "rl_sar" / "go2" / "robot_lab" / "policy.pt"
HIMLOCO = OTHERS / "rl_sar" / "go2" / "himloco" / "himloco.pt"
CPP_DEPLOY = OTHERS / "unitree_cpp_deploy" / "kaiwu2025_v6-2_124004"

needs_others = pytest.mark.skipif(
    not OTHERS.is_dir(), reason="policies of others are not here"
)
