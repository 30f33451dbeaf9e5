"""The page of one visitor: events in, question and poses out.

The ticker's thread owns everything here. Callbacks of viser only post events; what may
block is done at the desk by a worker, whose result comes back as one more event.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import viser

from data.answers.answer_records import Aspect
from labeling_ui.limits.pace import Bucket
from labeling_ui.limits.page_limits import (
    CHANGES_AT_ONCE,
    CHANGES_PER_S,
    EVENTS_PER_TURN,
)
from labeling_ui.questions.judgement import Judgement, Question, Verdict
from labeling_ui.scene.aim import Aim
from labeling_ui.scene.clip_motion import Motion
from labeling_ui.scene.fast_updates import Frames
from labeling_ui.scene.scene import PairScene, Pose

from .at_desk import AtDesk
from .controls import Controls
from .dialogs import Dialog, differed_dialog, guidelines_dialog, objection_dialog
from .loop_status import LoopStatus
from .page_access import Desk, Showing
from .playback import Playback
from .remarks import Marks, Remarks, remarks_of
from .shared import Shared
from .shortcuts import ASPECT_OF_LABEL, CONFIDENCE_OF, CONFIDENCES, Name
from .theme import set_theme
from .transport import Transport
from .view_habits import Habits

ACTIVE_S = 300.0
"""Without an event for longer than this, nobody is there."""
NOTE_LATE_S = 0.1
NOTE_RECENT_S = 0.3
"""A note's last letters may be on their way for 50 ms: an answer that soon after one
waits for them."""


_NOT_STORED = (
    "The last answer could not be stored. Give it again; if this goes on, tell whoever "
    "runs the page."
)


class Page:
    """One browser tab of one rater."""

    def __init__(
        self,
        client: viser.ClientHandle,
        desk: Desk,
        shared: Shared,
        habits: Habits,
        marks: Marks,
    ) -> None:
        """Build the page as `habits` say, with the marks that its browser kept; a first
        look at the desk is under way when this returns."""
        self.client = client
        self._desk, self._shared = desk, shared
        self._events: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
        self._at_desk = AtDesk(desk, shared.worker, shared.submit_late, self.post)
        self._changes = Bucket(per_s=CHANGES_PER_S, at_once=CHANGES_AT_ONCE)
        self._sign_of_life = time.monotonic()
        self._modal: Dialog | None = None
        self._showing: Showing | None = None
        self._clock = Playback(duration_s=1.0, frame_s=0.02, speed=habits.speed)
        self._drawn_at: float | None = None
        self._shown_at = time.monotonic()
        self._note_at = -NOTE_RECENT_S
        self._remarks, self._marks = Remarks(), marks
        # What was said of a question that an earlier one was opened over.
        self._aside: tuple[str | None, Remarks] = None, Remarks()
        self._late: tuple[float, Verdict] | None = None
        self._status: LoopStatus | None = None
        self._habits = habits
        self._frames = Frames(client)
        with client.atomic():
            set_theme(client.gui, dark=habits.dark)
            self._scene = PairScene(client)
            self._scene.darken(habits.dark)
            self._scene.look(habits.view)
            self._controls = Controls(client, self.post)
            self._controls.keep_habits(habits)
            self._transport = Transport(client, self.post)
            if habits.ghost:
                self._scene.toggle_ghosts()
            if habits.curves:
                self._transport.toggle_curves()
        self._aim = Aim(self._scene, client.camera)
        client.camera.on_update(self._seen_from)
        self._at_desk.look(Desk.look)

    async def _seen_from(self, camera: viser.CameraHandle) -> None:
        """Look anew where the window became wider or narrower."""
        if self._aim.is_lost(camera):
            self.post("resized")

    def post(self, name: str, value: Any = None) -> None:
        """Hand an event in; from any thread."""
        self._events.put((name, value))
        self._shared.wake()

    def attend(self) -> None:
        """Handle what came in."""
        for _ in range(EVENTS_PER_TURN):
            if self._events.empty():
                return
            self._handle(*self._events.get_nowait())

    def tick(self, elapsed_s: float, status: LoopStatus | None) -> None:
        """Handle what came in, and draw the next frame if something moved."""
        self.attend()
        self._answer_late()
        active = time.monotonic() - self._sign_of_life < ACTIVE_S
        self._at_desk.refresh(elapsed_s, self._showing, active=active)
        if status != self._status:
            self._status = status
            self._controls.fill_status(status)
        self._clock = self._clock.advance(elapsed_s)
        motions = None if self._showing is None else self._showing.motions
        if motions is None or self._drawn_at == self._clock.time_s:
            return
        self._drawn_at = self._clock.time_s
        poses = [self._pose(motion) for motion in motions]
        with self._frames.frame():
            self._scene.draw(*poses)
            self._transport.tick(self._clock, elapsed_s)

    def _pose(self, motion: Motion) -> Pose:
        over = self._clock.time_s >= motion.duration_s
        at_s = self._clock.time_s
        fallen = motion.fell and over
        return Pose(*motion.pose(at_s), fallen=fallen, way=motion.way(at_s))

    def _handle(self, name: str, value: Any) -> None:
        if name not in ("showing", "idle", "stored", "failed", "told_differed"):
            self._sign_of_life = time.monotonic()
        match name:
            case "showing":
                self._show(value)
            case "idle":
                self._at_desk.idle()
            case "stored":
                self._at_desk.stored()
            case "failed":
                self._controls.warn(_NOT_STORED)
            case "verdict":
                self._verdict(value)
            case "hotkey_verdict":
                if self._modal is None:
                    self._verdict(value)
                elif objection := self._modal.objection(value):
                    self.post("objection", objection)
            case "objection" if self._modal is not None:
                self._close_dialog()
                self._judge(value.verdict, value.words)
            case "why_label" if value in ASPECT_OF_LABEL:
                self._say_why(ASPECT_OF_LABEL[value])
            case "why":
                self._say_why(value)
            case "note":
                self._remarks = replace(self._remarks, note=value)
                self._note_at = time.monotonic()
            case "confidence" if value in CONFIDENCES:
                self._remarks = replace(self._remarks, confidence=value)
            case "seek":
                self._set_clock(self._clock.seek(value))
                self._transport.rest()
            case "resized":
                self._scene.look(self._scene.view)
                self._drawn_at = None
            case "reopen":
                self._reopen(value)
            case "told_differed":
                self._modal = self._modal or differed_dialog(
                    self.client, self.post, value
                )
            case _:
                self._act(name)  # type: ignore[arg-type]

    def _act(self, name: Name) -> None:
        """A shortcut, by key or by button."""
        if name == "close":
            self._close_dialog()
        elif name in _CHANGES and not self._changes.taken(time.monotonic()):
            return
        elif name == "guidelines":
            self._toggle_guidelines()
        elif name == "differed":
            self._tell_what_differed()
        elif self._modal is not None:
            return
        elif name in _CLOCK:
            self._set_clock(_CLOCK[name](self._clock))
            self._keep(replace(self._habits, speed=self._clock.speed))
        elif name in CONFIDENCE_OF:
            self._remark(replace(self._remarks, confidence=CONFIDENCE_OF[name]))
        elif name == "here":
            if self._showing is not None and self._showing.question is not None:
                self._remark(self._remarks.marked(self._clock.time_s))
                self._marks = Marks(
                    question_id=self._showing.question_id, here_s=self._remarks.here_s
                )
        elif name == "bad":
            if self._showing is not None and self._showing.question is not None:
                self._modal = objection_dialog(self.client, self.post)
        elif name == "undo":
            self._at_desk.store(Desk.undo)
        elif name == "keep":
            self._at_desk.store(Desk.keep)
        else:
            self._change_view(name)

    def _change_view(self, name: Name) -> None:
        scene, habits = self._scene, self._habits
        if name == "view":
            scene.look("lanes" if scene.view == "treadmill" else "treadmill")
            self._keep(replace(habits, view=scene.view))
            self._drawn_at = None
        elif name == "ghost":
            scene.toggle_ghosts()
            self._keep(replace(habits, ghost=not habits.ghost))
            self._drawn_at = None
        elif name == "camera":
            scene.look(scene.view)
        elif name == "theme":
            self._keep(replace(habits, dark=not habits.dark))
            set_theme(self.client.gui, dark=self._habits.dark)
            scene.darken(self._habits.dark)
        elif name == "curves":
            self._transport.toggle_curves()
            self._keep(replace(habits, curves=not habits.curves))
            if self._showing is not None:
                self._transport.fill(self._showing.motions, self._clock)

    def _keep(self, habits: Habits) -> None:
        if habits != self._habits:
            self._habits = habits
            self._controls.keep_habits(habits)

    def _say_why(self, why: Aspect) -> None:
        """What of the gait decides the answer; the same again takes it back."""
        if self._modal is None and self._showing and self._showing.question:
            said = None if why == self._remarks.why else why
            self._remark(replace(self._remarks, why=said))

    def _remark(self, remarks: Remarks) -> None:
        """Hold remarks that were made by key or button, and show them."""
        self._remarks = remarks
        self._controls.say(remarks)

    def _verdict(self, verdict: Verdict) -> None:
        late = time.monotonic() - self._note_at < NOTE_RECENT_S
        if late and self._late is None:
            self._late = (time.monotonic() + NOTE_LATE_S, verdict)
        elif not late:
            self._judge(verdict)

    def _answer_late(self) -> None:
        if self._late is not None and time.monotonic() >= self._late[0]:
            verdict, self._late = self._late[1], None
            self._judge(verdict)

    def _judge(self, verdict: Verdict, reason: str = "") -> None:
        if self._showing is None or self._showing.question_id is None:
            return
        clock = self._clock
        judgement = Judgement(
            question_id=self._showing.question_id,
            verdict=verdict,
            reason=reason,
            why=self._remarks.why or "",
            note=self._remarks.note.strip(),
            confidence=self._remarks.sure,
            watched_ms=round(1000 * clock.watched_s),
            response_ms=round(1000 * (time.monotonic() - self._shown_at)),
            client={"replays": clock.replays, "speed": clock.speed}
            | self._remarks.client,
            dialog_open=self._modal is not None,
        )
        self._at_desk.store(lambda desk: desk.answer(judgement))

    def _reopen(self, index: int) -> None:
        history = () if self._showing is None else self._showing.history
        if index < len(history) and self._modal is None:
            answer_id = history[index].answer.answer_id
            self._at_desk.store(lambda desk: desk.reopen(answer_id))

    def _show(self, showing: Showing) -> None:
        asked = None if self._showing is None else self._showing.question
        before = asked and asked.question_id
        if (
            asked is not None
            and asked.corrects is None
            and before != showing.question_id
        ):
            self._aside = before, self._remarks
        first, self._showing = self._showing is None, showing
        with self.client.atomic():
            who = self._desk.rater_id if self._shared.has_names else "you"
            self._controls.fill(who, showing)
            if first or before != showing.question_id:
                self._show_pair(showing)
                self._remarks = self._said_of(showing.question)
                if self._marks.question_id == showing.question_id:
                    here_s = self._marks.here_s
                    self._remarks = replace(self._remarks, here_s=here_s)
                self._controls.fill_remarks(self._remarks)
        self.client.flush()
        if first and showing.progress.answered == 0 and self._is_new(showing.question):
            self._welcome()

    def _said_of(self, question: Question | None) -> Remarks:
        """What was said of a question that is shown again."""
        of, aside = self._aside
        if question is not None and question.question_id == of:
            return aside
        return remarks_of(question and question.remarked)

    def _show_pair(self, showing: Showing) -> None:
        motions = showing.motions
        geometries = (None, None) if motions is None else tuple(
            motion.geometry for motion in motions
        )  # fmt: skip
        self._scene.show(*geometries)
        self._shown_at, self._drawn_at = time.monotonic(), None
        if motions is not None:
            self._clock = Playback(
                duration_s=max(motion.duration_s for motion in motions),
                frame_s=min(motion.dt_s for motion in motions),
                speed=self._clock.speed,
            )
        self._transport.fill(motions, self._clock)

    def _set_clock(self, clock: Playback) -> None:
        self._clock = clock
        if self._showing is not None and self._showing.motions is not None:
            self._transport.align(clock)

    def _is_new(self, question: Question | None) -> bool:
        """Whether no server before this one showed a question to the rater."""
        return question is None or question.shown_utc >= self._shared.since_utc

    def _welcome(self) -> None:
        if self._desk.rater_id not in self._shared.welcomed:
            self._shared.welcomed.add(self._desk.rater_id)
            self._toggle_guidelines()

    def _toggle_guidelines(self) -> None:
        if self._modal is None:
            # At once: who answers before they are there would be held up by them.
            text = self._shared.guidelines()
            self._modal = guidelines_dialog(self.client, self.post, text)
        else:
            self._close_dialog()

    def _tell_what_differed(self) -> None:
        if self._modal is not None:
            self._close_dialog()
            return
        self._shared.worker.submit(self._look_what_differed)

    def _look_what_differed(self) -> None:
        told, picture = self._desk.differed(), self._shared.picture
        if picture is None or told.of is None:
            self.post("told_differed", told)
            return
        of = told.of
        self._shared.submit_late(
            lambda: self.post("told_differed", replace(told, picture=picture(*of)))
        )

    def _close_dialog(self) -> None:
        if self._modal is not None:
            self._modal.close()
            self._modal = None


_CHANGES = (
    "bad",
    "guidelines",
    "differed",
    "view",
    "ghost",
    "camera",
    "theme",
    "curves",
)
"""What makes much of the page anew."""
_CLOCK: dict[str, Callable[[Playback], Playback]] = {
    "play": Playback.toggle,
    "replay": Playback.replay,
    "back": lambda clock: clock.step(-1),
    "on": lambda clock: clock.step(1),
    "slower": lambda clock: clock.faster(-1),
    "faster": lambda clock: clock.faster(1),
}
