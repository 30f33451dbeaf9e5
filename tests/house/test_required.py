"""What CI promises to have: a test that lacks it there fails and does not skip."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.helpers.required import EXTRAS, lacking, needed

ROOT = Path(__file__).resolve().parents[2]


def test_what_is_lacking_skips_a_test_or_fails_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("GAITPREF_REQUIRE_RAY", raising=False)
    with pytest.raises(pytest.skip.Exception, match=r"no_such_ray.* \(extra `scale`"):
        needed("no_such_ray", "RAY")
    monkeypatch.setenv("GAITPREF_REQUIRE_RAY", "1")
    with pytest.raises(pytest.fail.Exception, match="GAITPREF_REQUIRE_RAY is set, but"):
        needed("no_such_ray", "RAY")
    with pytest.raises(pytest.skip.Exception, match="no caddy"):
        lacking("CADDY", "no caddy")
    assert needed("json", "RAY").loads("1") == 1


def test_ci_lacks_nothing() -> None:
    """All that tests ask for by name; Caddy alone stays a matter of who has it."""
    told = re.search(r"for \w+ in ([A-Z0-9 ]+); do", (ROOT / ".ci/run").read_text())
    assert told is not None
    assert set(told[1].split()) == {"POSTGRES", "NGINX", "S3", *EXTRAS}
    for path in (ROOT / "tests").rglob("*.py"):
        skipped = re.findall(r'importorskip\(\s*"(\w+)', path.read_text())
        assert not {"ray", "warp", "mujoco_warp", "fsspec"} & set(skipped), path
