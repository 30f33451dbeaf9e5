"""The page of `gaitpref play`: drive a policy, or two on the same commands."""

from __future__ import annotations

import html
import queue
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
import viser

from labeling_ui.page.controls import (
    FLOATING_PX,
    PANEL_WIDTH_PX,
    posts,
    posts_value,
)
from labeling_ui.page.footfall_svg import live_footfalls
from labeling_ui.page.loop_status import LoopStatus, no_status
from labeling_ui.page.theme import BRAND_RGB, NEUTRAL_RGB, SIDE_RGBS, set_theme
from labeling_ui.questions.rater_figures import RaterFigures
from labeling_ui.scene.aim import Aim
from labeling_ui.scene.live_robot import HISTORY_S, Drive, LivePolicy, LiveRobot, StepFn
from labeling_ui.scene.scene import NAMES, PairScene
from labeling_ui.shell.key_map import KeyGroup
from labeling_ui.shell.page_shell import Shell
from labeling_ui.web.proxy_cfg import ProxyCfg
from labeling_ui.web.tokens import TokenStore

from .site import Site

COMMAND_RANGES = (
    ("forward, m/s", -0.5, 1.5, 0.5),
    ("left, m/s", -0.5, 0.5, 0.0),
    ("turn left, rad/s", -1.0, 1.0, 0.0),
)
"""Name, lowest, highest and first value of each slider."""
SPEEDS = ("0.25x", "0.5x", "1x", "2x")
PUSH_M_S = 0.7
Key = Literal[
    "P", "space", "R", "X", "T", "C", "M", "I", "K", "J", "L", "1", "2"
]  # fmt: skip
Button = tuple[Key, str, int | None, str, tuple[int, int, int]]
"""Key, event and its value, words and colour."""
Like = Callable[[Sequence[StepFn], int], str]
"""Keeps that of the robots, as they are stepped, one is liked; gives what to say."""
_READOUT_S = 0.2
_MAX_STEPS_A_TICK = 3


class PlayPage:
    """One browser tab; its robots are its own."""

    def __init__(
        self,
        client: viser.ClientHandle,
        policies: tuple[LivePolicy, ...],
        like: Like | None = None,
    ) -> None:
        """
        Args:
            client: The tab.
            policies: One, or two on the same commands.
            like: Keeps which of two robots the visitor likes; None does not ask.
        """
        self._client, self._like = client, like
        self._robots = tuple(LiveRobot(policy) for policy in policies)
        self._events: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
        self._command = [first for _, _, _, first in COMMAND_RANGES]
        self._playing, self._speed, self._dark = True, 1.0, False
        self._owed_s = self._readout_in_s = 0.0
        self._push = self._reset = False
        self._rng = np.random.default_rng()
        with client.atomic():
            set_theme(client.gui, dark=False)
            self._scene = PairScene(client, robots=len(policies))
            geometries = [policy.geometry for policy in policies]
            self._scene.show(*geometries, *[None] * (2 - len(geometries)))
            self._build(client.gui)
        self._aim = Aim(self._scene, client.camera)
        client.camera.on_update(self._seen_from)

    async def _seen_from(self, camera: viser.CameraHandle) -> None:
        """Look anew where the window became wider or narrower."""
        if self._aim.is_lost(camera):
            self.post("camera")

    def post(self, name: str, value: Any = None) -> None:
        """Hand an event in; from any thread."""
        self._events.put((name, value))

    def attend(self) -> None:
        """Handle what came in."""
        while not self._events.empty():
            self._handle(*self._events.get_nowait())

    def tick(self, elapsed_s: float, status: LoopStatus | None) -> None:
        """Simulate what is due and draw it."""
        del status
        self.attend()
        if not self._playing and not self._reset:
            return
        dt_s = self._robots[0].policy.control_dt_s
        self._owed_s = min(
            self._owed_s + elapsed_s * self._speed, _MAX_STEPS_A_TICK * dt_s
        )
        if self._reset:
            self._owed_s = dt_s
        while self._owed_s >= dt_s - 1e-9:
            self._owed_s -= dt_s
            self._step()
        with self._client.atomic():
            poses = [robot.pose() for robot in self._robots]
            self._scene.draw(*poses, *[None] * (2 - len(poses)))
            self._readout_in_s -= elapsed_s
            if self._readout_in_s <= 0:
                self._readout_in_s = _READOUT_S
                self._show_figures()
        self._client.flush()

    def _step(self) -> None:
        angle = self._rng.uniform(0, 2 * np.pi)
        push = (PUSH_M_S * np.cos(angle), PUSH_M_S * np.sin(angle))
        forward, left, yaw = self._command
        drive = Drive(
            command=(forward, left, yaw),
            push_m_s=push if self._push else (0.0, 0.0),
            reset=self._reset,
        )
        self._push = self._reset = False
        for robot in self._robots:
            robot.step(drive)

    def _handle(self, name: str, value: Any) -> None:
        if name.startswith("command"):
            self._command[int(name[-1])] = float(value)
        elif name == "stand":
            self._ask([0.0, 0.0, 0.0])
        elif name == "turn":
            index, by = value
            asked = list(self._command)
            low, high = COMMAND_RANGES[index][1:3]
            asked[index] = min(high, max(low, round(asked[index] + by, 2)))
            self._ask(asked)
        elif name == "like":
            assert self._like is not None
            steps = [robot.step_fn for robot in self._robots]
            told = html.escape(self._like(steps, value))
            self._told.content = f'<div style="{_TOLD}" role="status">{told}</div>'
        elif name == "push":
            self._push = True
        elif name == "play":
            self._playing = not self._playing
        elif name == "reset":
            self._reset = True
        elif name == "speed":
            self._speed = float(value.removesuffix("x"))
        elif name == "view":
            views = {"treadmill": "lanes", "lanes": "treadmill"}
            self._scene.look(views[self._scene.view])  # type: ignore[arg-type]
        elif name == "camera":
            self._scene.look(self._scene.view)
        elif name == "theme":
            self._dark = not self._dark
            set_theme(self._client.gui, dark=self._dark)
            self._scene.darken(self._dark)

    def _ask(self, command: list[float]) -> None:
        """Command the robots, and let the sliders show it."""
        self._command = command
        for slider, value in zip(self._sliders, command, strict=True):
            slider.value = value

    def _build(self, gui: viser.GuiApi) -> None:
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH_PX)
        self._head = gui.add_html("")
        self._sliders = [
            gui.add_slider(name, low, high, 0.05, first)
            for name, low, high, first in COMMAND_RANGES
        ]
        for index, slider in enumerate(self._sliders):
            slider.on_update(posts_value(self.post, f"command{index}"))
        for key, words, index, by in _STEERING:
            command = gui.add_command(words, hotkey=key)
            command.on_trigger(posts(self.post, "turn", (index, by)))
        if self._like is not None:
            self._add_buttons(gui, _LIKES)
        self._told = gui.add_html("")
        self._add_buttons(gui, _KEYS)
        speed = gui.add_dropdown("speed", SPEEDS, initial_value="1x")
        speed.on_update(posts_value(self.post, "speed"))
        panel = gui.add_panel()
        with panel.add_tab(f"Footfalls of the last {HISTORY_S:g} s"):
            self._strip = gui.add_html("")
        panel.float(x=12, y=-12, width=FLOATING_PX)

    def _add_buttons(self, gui: viser.GuiApi, keys: tuple[Button, ...]) -> None:
        for key, name, value, words, colour in keys:
            button = gui.add_button(f"{words} [{key}]", color=colour)
            button.on_click(posts(self.post, name, value))
            command = gui.add_command(words, hotkey=key)
            command.on_trigger(posts(self.post, name, value))

    def _show_figures(self) -> None:
        dt_s = self._robots[0].policy.control_dt_s
        contacts = [robot.contacts for robot in self._robots]
        self._strip.content = live_footfalls(contacts, dt_s, HISTORY_S)
        self._head.content = "".join(
            _figures(name, robot)
            for name, robot in zip(NAMES, self._robots, strict=False)
        )


def _figures(name: str, robot: LiveRobot) -> str:
    state = robot.state
    numbers = "" if state is None else (
        f"{state.speed_m_s:+.2f} m/s forward, base at {state.height_m:.2f} m, "
        f"{robot.falls} falls"
    )  # fmt: skip
    return (
        '<div data-gp-ready style="padding:2px 12px 6px;font-size:13px"><b>'
        f"{name}</b> {html.escape(robot.policy.name)}<br>{numbers}</div>"
    )


_TOLD = "padding:2px 12px 6px;font-size:13px"
_STEERING: tuple[tuple[Key, str, int, float], ...] = (
    ("I", "Faster", 0, 0.1),
    ("K", "Slower", 0, -0.1),
    ("J", "Turn left", 2, 0.2),
    ("L", "Turn right", 2, -0.2),
)
"""Key, words, which command, and by how much; W, A, S and D move the camera."""
_LIKES: tuple[Button, ...] = (
    ("1", "like", 0, "A walks as it should", SIDE_RGBS[0]),
    ("2", "like", 1, "B walks as it should", SIDE_RGBS[1]),
)
_KEYS: tuple[Button, ...] = (
    ("P", "push", None, "Push", BRAND_RGB),
    ("space", "play", None, "Pause or go on", BRAND_RGB),
    ("R", "reset", None, "Reset", NEUTRAL_RGB),
    ("X", "stand", None, "Stand still", NEUTRAL_RGB),
    ("T", "view", None, "Other view", NEUTRAL_RGB),
    ("C", "camera", None, "Reset the camera", NEUTRAL_RGB),
    ("M", "theme", None, "Light or dark", NEUTRAL_RGB),
)


_STICKS: tuple[tuple[int, Key, Key], ...] = (
    (1, "I", "K"),
    (0, "J", "L"),
    (2, "J", "L"),
)
"""Axis of a gamepad, and which keys its lower and its upper end are."""
_PAD: dict[int, Key] = {
    0: "P", 1: "X", 3: "R", 9: "space", 12: "I", 13: "K", 14: "J", 15: "L",
}  # fmt: skip
"""Buttons of a gamepad, as browsers number them on all, and their keys."""
_PAD_LIKES: dict[int, Key] = {4: "1", 5: "2"}
_PAD_WORDS = (
    ("stick", "Faster, slower, turn"),
    ("A", "Push"),
    ("B", "Stand still"),
    ("Y", "Reset"),
    ("start", "Pause or go on"),
)
_PAD_LIKES_WORDS = (("LB RB", "A, B walks as it should"),)


def _shell(*, likes: bool) -> Shell:
    buttons = (_LIKES if likes else ()) + _KEYS
    drive = [(key, words) for key, words, _, _ in _STEERING]
    drive += [(key, words) for key, _, _, words, _ in buttons]
    on_pad = _PAD_WORDS + (_PAD_LIKES_WORDS if likes else ())
    pad = {
        "axes": _STICKS,
        "buttons": _PAD | (_PAD_LIKES if likes else {}),
        "again": [key for key, *_ in _STEERING],
    }
    return Shell(
        title="Drive a policy",
        scene="Robots that walk as the sliders ask",
        keys=(KeyGroup("Drive", tuple(drive)), KeyGroup("With a gamepad", on_pad)),
        words={"answers": {}, "sureKeys": {}, "whyKeys": {}, "pad": pad},
    )


def play_site(port: int, tokens: TokenStore, *, likes: bool = False) -> Site:
    """A site on loopback, without a login; start it with a maker of `PlayPage`, who
    asks what is liked or does not."""

    def no_figures(rater_id: str) -> RaterFigures:
        raise KeyError(rater_id)

    cfg = ProxyCfg(port=port, auth=False, max_clients=4, max_clients_per_rater=4)
    return Site(
        cfg,
        tokens=tokens,
        figures=no_figures,
        shell=_shell(likes=likes),
        status=no_status,
    )
