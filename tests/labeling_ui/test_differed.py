"""What is told of the pair that was answered last."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from benchmarks.walks import walk
from data.answers.answer_records import Pair
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from labeling_ui.page.page_access import Desk
from labeling_ui.questions.judgement import Judgement, Question
from labeling_ui.questions.key_repeat import GuardCfg
from labeling_ui.questions.rater_session import QueueCfg, RaterSession
from labeling_ui.scene.clip_motion import MotionCache

AT_ONCE = GuardCfg(min_shown_s=0.0, repeat_gap_s=0.0, same_verdict_s=0.0)


@contextmanager
def asked_about(
    root: Path, step_hz: tuple[float, float], seed: int = 0
) -> Iterator[tuple[Desk, Question, str]]:
    """A desk, the question on it about two robots that take so many steps, and which
    side the second one is on."""
    dataset = Dataset.create(root)
    clips = [
        Clip(entry.sha256, 0, 60)
        for entry in dataset.add_episodes(
            walk(120, seed=index, step_hz=hz) for index, hz in enumerate(step_hz)
        )
    ]
    with dataset.answers() as store:
        store.add_pairs([Pair.make(*clips, strategy="s", round=0)])
        rng = np.random.default_rng(seed)
        session = RaterSession(store, "ann", cfg=QueueCfg(guard=AT_ONCE), rng=rng)
        desk = Desk(session, MotionCache(dataset))
        question = desk.look().question
        assert question is not None
        yield desk, question, "A" if question.left == clips[1] else "B"


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_names_the_sides_as_they_were_shown(tmp_path: Path, seed: int) -> None:
    """The quick one is A or B, as the lot fell."""
    with asked_about(tmp_path / "set", (2.0, 3.0), seed) as (desk, question, quick):
        assert desk.differed().says == "You have not answered yet."
        judgement = Judgement(question_id=question.question_id, verdict="left")
        assert desk.answer(judgement).accepted
        said = f"{quick} takes 1.0 more strides a second."
        assert desk.differed().differences == (said,)
        assert desk.reopen(question.question_id).accepted
        assert (
            desk.differed().says == "You are asked about this pair now: answer first."
        )
        assert desk.keep().accepted
        assert desk.differed().differences == (said,)
        assert desk.undo().accepted
        assert desk.differed().differences == ()


@pytest.mark.parametrize("quick_hz", [2.3, 2.0])
def test_what_is_finer_than_people_notice_is_told_as_that(
    tmp_path: Path, quick_hz: float
) -> None:
    """Of two thirds of it the habit is named all the same; of next to nothing none."""
    with asked_about(tmp_path / "set", (2.0, quick_hz)) as (desk, question, quick):
        judgement = Judgement(question_id=question.question_id, verdict="equal")
        assert desk.answer(judgement).accepted
        told = desk.differed()
    assert told.says.startswith("They differ in nothing that people usually notice")
    if quick_hz > 2.0:
        assert told.says.endswith(", a little in this:")
        assert told.differences == (f"{quick} takes 0.3 more strides a second.",)
    else:
        assert told.differences == ()
