"""Raters who want different things are told apart, and from those who err."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from gaitpref.raters import rater_groups
from gaitpref.raters.rater_groups import answers_for, told, who_agrees
from gaitpref.report.trust_section import groups_section
from rewardmodel import FitCfg
from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.errors import RewardError
from rewardmodel.posterior.group_raters import group_raters, spread
from tests.helpers.answered_sets import fill, gaits
from tests.rewardmodel.test_curves import Taste, asked, best_height, one_foot

POSTERIOR = FitCfg(kind="posterior", tie_threshold=0.3)
EACH = 24


def answers_of(tastes: Sequence[Taste | None], *, seed: int) -> AnsweredPairs:
    """Answers of `ada`, `bob`, ..., who want one thing each; None says anything."""
    names = ("ada", "bob", "cyd", "dan")[: len(tastes)]
    pairs = asked(best_height, EACH * len(tastes), seed=seed)
    rng = np.random.default_rng(seed)
    targets = []
    for number, taste in enumerate(tastes):
        rows = slice(number * EACH, (number + 1) * EACH)
        if taste is None:
            targets.append(torch.from_numpy(rng.random(EACH) < 0.5).float())
            continue
        sides = (pairs.left.features[rows], pairs.right.features[rows])
        targets.append((taste(sides[0]) > taste(sides[1])).float())
    return replace(
        pairs,
        target=torch.cat(targets),
        raters=tuple(name for name in names for _ in range(EACH)),
        times=tuple(f"2030-01-01T00:{row % EACH:02d}" for row in range(len(pairs))),
    )


def test_two_wishes_are_two_groups_and_who_guesses_is_in_one_of_them() -> None:
    pairs = answers_of((best_height, best_height, one_foot, None), seed=2)
    found = group_raters(pairs, POSTERIOR, seed=0)
    of_ada, of_cyd = found.group_of("ada"), found.group_of("cyd")
    assert of_ada
    assert of_cyd
    assert len(found.groups) == 2
    assert {"ada", "bob"} <= set(of_ada.raters)
    assert not {"ada", "bob"} & set(of_cyd.raters)
    assert of_ada.wanted[0].habit == "height"
    assert of_cyd.wanted[0].habit.endswith("_RL")
    assert of_cyd.wanted[0].how == "more"
    assert found.changed == ()
    assert found.group_of("eve") is None
    lines = told(found, Path("my set"))
    assert lines[0] == "2 groups want different things:"
    hint = "`gaitpref fit --dataset 'my set' --out REWARD --for group:ada`"
    assert hint in lines[-1]


def test_one_wish_is_one_group() -> None:
    pairs = answers_of((best_height,) * 3, seed=3)
    found = group_raters(pairs, POSTERIOR, seed=0)
    assert [group.raters for group in found.groups] == [("ada", "bob", "cyd")]
    assert found.groups[0].answers == 3 * EACH


def test_a_taste_that_changes_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the order the answers were given in, and not where nobody knows it. A report
    says it of somebody who answers alone, too, and what to do."""
    pairs = answers_of((best_height, one_foot), seed=4)
    pairs = replace(
        pairs,
        raters=("ada",) * len(pairs),
        times=tuple(f"2030-01-01T00:{row:02d}" for row in range(len(pairs))),
    )
    found = group_raters(pairs, POSTERIOR, seed=0)
    (changed,) = found.changed
    assert changed.rater == "ada"
    assert changed.after == EACH
    monkeypatch.setattr(rater_groups, "load_pairs", lambda *_, **__: pairs)
    monkeypatch.setattr(rater_groups, "grouping_of", lambda *_: found)
    dataset = Dataset.create(tmp_path / "set")
    (line,) = who_agrees(dataset, unchecked=True, alone=True)
    assert line.startswith(f"ada seems to want something else since answer {EACH + 1}")
    assert line.endswith("begin another data set or run")
    assert who_agrees(dataset, unchecked=True, alone=False) == []
    assert not group_raters(replace(pairs, times=()), POSTERIOR, seed=0).changed


def test_who_only_grows_careless_wants_the_same() -> None:
    """Right at first, coins later: that is no other wish."""
    pairs = answers_of((best_height, None), seed=4)
    pairs = replace(
        pairs,
        raters=("ada",) * len(pairs),
        times=tuple(f"2030-01-01T00:{row:02d}" for row in range(len(pairs))),
    )
    assert group_raters(pairs, POSTERIOR, seed=0).changed == ()


def test_of_many_answers_some_of_all_times_are_looked_at() -> None:
    """One more than are looked at does not halve them."""
    assert spread(range(40)) == list(range(40))
    some = spread(range(41))
    assert len(some) == 40
    assert some[0] == 0
    assert max(b - a for a, b in pairwise(some)) <= 2


def test_those_with_most_answers_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rewardmodel.posterior.group_raters._MOST_RATERS", 2)
    pairs = answers_of((best_height, best_height), seed=2)
    pairs = replace(pairs, raters=(*pairs.raters[:-2], "few", "few"))
    found = group_raters(pairs, POSTERIOR, seed=0)
    assert [group.raters for group in found.groups] == [("ada", "bob")]
    assert found.untold == ("few",)
    with pytest.raises(RewardError, match="only those with most answers"):
        answers_for(pairs, ["group:few"])


def test_answers_of_a_rater_or_of_a_group_are_picked() -> None:
    pairs = answers_of((best_height, one_foot, best_height), seed=2)
    assert set(answers_for(pairs, ["bob"]).raters) == {"bob"}
    assert set(answers_for(pairs, ["group:ada"]).raters) == {"ada", "cyd"}
    assert len(answers_for(pairs, ["bob", "ada"])) == 2 * EACH
    with pytest.raises(RewardError, match=r"--for eve: no such rater.*ada, bob, cyd"):
        answers_for(pairs, ["eve"])
    few = pairs.subset(torch.arange(len(pairs)) >= EACH - 3)
    with pytest.raises(RewardError, match="3 answers prefer a clip, a fit needs 8"):
        answers_for(few, ["ada"])


def test_the_commands_say_who_wants_what(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a data set of one rater there is one group; and a fit for that rater."""
    dataset = gaits(tmp_path / "set", 40)
    fill(dataset, "ada", lambda number, likes, left: "a" if likes else "b")
    root = str(dataset.root)
    assert main(["raters", "--dataset", root, "groups", "--json"]) == 0
    (group,) = json.loads(capsys.readouterr().out)["groups"]
    (name,) = group["raters"]
    assert main(["raters", "--dataset", root, "groups"]) == 0
    assert f"all want the same: {name}" in capsys.readouterr().out
    fill(dataset, "eve", lambda number, likes, left: "a" if likes else "b")
    reward = str(tmp_path / "reward")
    fit = ["fit", "--dataset", root, "--out", reward]
    assert main([*fit, "--for", name]) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert f"trust --reward {reward} --dataset {root} --for ada`" in told
    trust = ["trust", "--dataset", root, "--reward", reward, "--json", "--for"]
    assert main([*trust, name]) == 0
    of_ada = json.loads(capsys.readouterr().out)
    assert of_ada["answers_are_those_fitted"]
    assert of_ada["alarm"] is None
    for command in ([*fit, "--for"], trust):
        assert main([*command, "nobody"]) == 2
        assert "--for nobody: no such rater" in capsys.readouterr().err


def test_a_report_says_who_agrees(tmp_path: Path) -> None:
    """Of two who answered enough; in words that a page may hold."""
    dataset = gaits(tmp_path / "set", 40)
    fill(dataset, "ada", lambda number, likes, left: "a" if likes else "b")
    assert who_agrees(dataset, unchecked=True, alone=False) == []
    fill(dataset, "<bob>", lambda number, likes, left: "a" if likes else "b")
    lines = who_agrees(dataset, unchecked=True, alone=False)
    assert lines[0] == "all want the same: <bob>, ada"
    page = groups_section([{"groups": lines}])
    assert "all want the same: &lt;bob&gt;, ada<br>&emsp;" in page
    assert groups_section([{}]) == ""
