"""Clips, pairs and policies as films, and the robot on the page of a run."""

from __future__ import annotations

import re
import threading
import weakref
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import mujoco
import numpy as np
import pytest
from matplotlib.axes import Axes
from PIL import Image

from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from gaitpref import __version__
from gaitpref.cli.commands.looking import film as film_command
from gaitpref.cli.main import main
from gaitpref.console import progress
from gaitpref.film import camera, reel
from gaitpref.film.camera import CameraCfg, NoRenderer, frames_of
from gaitpref.film.endless_floor import endless_floor
from gaitpref.film.reel import Film, FilmCfg, film, frame_count, webp_of, write_film
from gaitpref.film.shot import Shot, shot_of
from gaitpref.film.sources import before_and_after, shot_of_clip, shot_of_policy
from gaitpref.film.stick_figure import leg_lines, stick_figures
from gaitpref.loop import run_report
from gaitpref.loop.run_config import read_config
from gaitpref.loop.run_report import read_rounds, write_report
from gaitpref.report.film_section import pace_of_clip
from gaitpref.report.journal import JOURNAL_NAME, note_round, note_start
from policy.rollouts.record_cfg import recorded_commands
from policy.training.checkpoint import load_policy
from tests.helpers import curves_of_reports
from tests.helpers.older_run import older_run

SMALL = FilmCfg(camera=CameraCfg(width_px=96, height_px=72), fps=10)


@pytest.fixture(scope="module", autouse=True)
def drawing() -> Iterator[None]:
    """Where the machine can, pictures are drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MUJOCO_GL", raising=False)
        yield


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return older_run(tmp_path_factory.mktemp("older") / "run")


@pytest.fixture(scope="module")
def shot(run: Path) -> Shot:
    dataset = Dataset.open(run / "dataset")
    longest = max(dataset.entries(), key=lambda entry: entry.num_steps)
    return shot_of(dataset.read(longest.sha256))


@pytest.fixture(scope="module")
def drawn(shot: Shot) -> list[np.ndarray]:
    """Frames, where this machine draws any."""
    try:
        return list(film((shot,), SMALL))
    except NoRenderer as why:
        pytest.skip(str(why))


def test_a_film_lasts_as_long_as_its_motion(
    shot: Shot, drawn: list[np.ndarray]
) -> None:
    assert len(drawn) == round(shot.duration_s * SMALL.fps)
    assert {frame.shape for frame in drawn} == {(72, 96, 3)}


def test_the_robot_is_in_the_middle_and_moves(drawn: list[np.ndarray]) -> None:
    """The sky and the corners hold no robot; the middle is darker and changes."""
    first, last = drawn[0].astype(int), drawn[-1].astype(int)
    middle = (slice(24, 60), slice(24, 72))
    assert first[middle].min() < 60 < first[:12].min()
    assert np.abs(last - first)[middle].max() > 60


def test_two_shots_stand_side_by_side_under_their_names(
    shot: Shot, drawn: list[np.ndarray]
) -> None:
    short = Shot(mjcf=shot.mjcf, qpos=shot.qpos[:10], dt_s=shot.dt_s, caption="short")
    both = list(film((shot, short), SMALL))
    assert len(both) == len(drawn)
    assert (both[3][:, :96] == drawn[3]).all()
    assert (both[3][:12, 96:] == 255).any()
    # What is over stays where it ended.
    assert (both[-1][:, 96:] == both[-2][:, 96:]).all()


def test_a_film_that_is_stopped_leaves_no_thread_that_draws(
    shot: Shot, drawn: list[np.ndarray]
) -> None:
    """Nor does one whose second robot cannot be drawn, which says why."""
    frames = film((shot, shot), SMALL)
    next(frames)
    frames.close()
    broken = Shot(mjcf="<mujoco", qpos=shot.qpos, dt_s=shot.dt_s)
    with pytest.raises(GaitprefError, match="does not compile"):
        list(film((shot, broken), SMALL))
    names = [thread.name for thread in threading.enumerate()]
    assert not [name for name in names if name.startswith("drawing")]


def test_a_policy_is_filmed_under_the_nearest_recorded_command(run: Path) -> None:
    policy = run / "rounds" / "00" / "policy" / "policy.pt"
    commands = recorded_commands(load_policy(policy).info.env.commands)
    forward, left, _ = commands[-2]
    shot = shot_of_policy(policy, (forward + 0.01, left, -0.01), duration_s=0.2)
    assert f"({forward:g}, {left:g}, 0)" in shot.caption
    assert len(shot.qpos) <= 10


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_a_film_is_a_file_of_as_many_pictures(
    tmp_path: Path, drawn: list[np.ndarray], suffix: str
) -> None:
    path = tmp_path / "new" / f"film{suffix}"
    write_film(iter(drawn), path, SMALL.fps)
    with Image.open(path) as picture:
        # Equal pictures that follow one another are one that stays longer.
        assert 1 < getattr(picture, "n_frames", 1) <= len(drawn)
        assert picture.size == (96, 72)
    assert [p.name for p in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_a_film_is_encoded_while_it_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    """No picture waits for the last one."""
    pictures: list[weakref.ref[Image.Image]] = []
    made = Image.fromarray

    def noted(frame: np.ndarray) -> Image.Image:
        picture = made(frame)
        pictures.append(weakref.ref(picture))
        return picture

    def drawn():
        for number in range(20):
            assert sum(picture() is not None for picture in pictures) <= 1
            yield np.full((16, 16, 3), 12 * number, np.uint8)

    monkeypatch.setattr(Image, "fromarray", noted)
    path = tmp_path / f"film{suffix}"
    write_film(Film(drawn(), 20), path, 10)
    with Image.open(path) as film_again:
        assert getattr(film_again, "n_frames", 1) == len(pictures) == 20


def test_mp4_is_what_it_says(tmp_path: Path, drawn: list[np.ndarray]) -> None:
    pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "film.mp4"
    write_film(iter(drawn), path, SMALL.fps)
    assert path.read_bytes()[4:8] == b"ftyp"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_an_interrupted_film_leaves_nothing(
    tmp_path: Path, drawn: list[np.ndarray]
) -> None:
    pytest.importorskip("imageio_ffmpeg")

    def frames():
        yield from drawn[:2]
        raise KeyboardInterrupt

    for suffix in reel.KINDS:
        with pytest.raises(KeyboardInterrupt):
            write_film(frames(), tmp_path / f"film{suffix}", SMALL.fps)
    assert list(tmp_path.iterdir()) == []


def test_a_policy_is_filmed_from_the_command_line(
    run: Path,
    tmp_path: Path,
    drawn: list[np.ndarray],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It says how far it is with the recording, and that it encodes."""
    told: list[str] = []

    def working(title: str) -> AbstractContextManager[None]:
        told.append(title)
        return nullcontext()

    monkeypatch.setattr(progress, "_QUIET_S", 0.0)
    monkeypatch.setattr(film_command, "working", working)
    policy, out = run / "rounds" / "00" / "policy" / "policy.pt", tmp_path / "walk.webp"
    small = ["--duration-s", "1", "--width-px", "64", "--height-px", "48", "--fps", "5"]
    assert main(["film", "--policy", str(policy), "--out", str(out), *small]) == 0
    with Image.open(out) as picture:
        assert picture.size == (64, 48)
    assert told == ["encoding 5 frames"]
    assert "recording, steps: 1 of 50, " in capsys.readouterr().err


@pytest.mark.parametrize(("what", "wide"), [("--clip", 64), ("--pair", 128)])
def test_a_clip_and_a_pair_are_filmed_from_the_command_line(
    run: Path,
    tmp_path: Path,
    drawn: list[np.ndarray],
    capsys: pytest.CaptureFixture[str],
    what: str,
    wide: int,
) -> None:
    """A clip alone, of the ten steps that are named; of a pair both clips, A on the
    left, which is the same robot as the clip is."""
    dataset, out = Dataset.open(run / "dataset"), tmp_path / "film.webp"
    with dataset.answers_copy() as store:
        pair = store.pairs()[0]
    name = {
        "--clip": f"{pair.a.rollout[:16]}:{pair.a.start}+10",
        "--pair": pair.pair_id,
    }
    small = ["--width-px", "64", "--height-px", "48", "--fps", "5"]
    line = ["film", "--dataset", str(dataset.root), what, name[what], "--out", str(out)]
    assert main([*line, *small]) == 0
    steps = 10 if what == "--clip" else max(pair.a.steps, pair.b.steps)
    with Image.open(out) as picture:
        assert picture.size == (wide, 48)
        assert 1 <= getattr(picture, "n_frames", 1) <= round(steps * 0.02 * 5)
        shown = np.asarray(picture.convert("RGB"), int)[20:]
    (first,) = frames_of(
        dataset.read(pair.a.rollout).mjcf,
        shot_of_clip(dataset, pair.a).qpos[:1],
        CameraCfg(width_px=64, height_px=48),
    )
    # The picture is stored with losses.
    off = [np.abs(half - first[20:]).mean() for half in np.split(shown, wide // 64, 1)]
    assert off[0] < 6
    assert wide == 64 or off[0] < 0.7 * off[1]
    assert f"gaitpref data view --dataset {dataset.root}" in capsys.readouterr().err


def test_what_cannot_be_filmed_is_said(
    run: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    dataset = str(run / "dataset")
    for line, said in (
        ("--out a.avi", "must end in .mp4, .gif, .webp"),
        ("--out a.gif --clip ab", "none is given"),
        ("--out a.gif --width-px 5000", "16 to 4096"),
        ("--out a.gif --speed 0", "speed of 0.01"),
        (f"--out a.gif --dataset {dataset}", "either --clip or --pair"),
        (f"--out a.gif --dataset {dataset} --pair zz", "0 of 12 pairs begin"),
    ):
        assert main(["film", *line.split()]) == 2
        assert said in capsys.readouterr().err


def test_the_page_of_a_run_shows_before_and_after(
    run: Path, drawn: list[np.ndarray]
) -> None:
    heard: list[tuple[int, int]] = []
    with curves_of_reports.drawn():
        text = write_report(run, lambda *done_of: heard.append(done_of)).read_text()
    assert heard == [(done, 7) for done in range(1, 8)]
    assert "No film is shown" not in text
    assert "Learned return: before and after" in text
    pictures = re.findall(r'src="data:image/webp;base64,([^"]+)"', text)
    assert pictures
    assert len(text) < 5_000_000
    # The clips the reward likes and dislikes, as film and as footfalls.
    likes = text[text.index("likes</h2>") :].split("</figure>")
    clips = [figure for figure in likes if "<figcaption>best 1" in figure]
    assert len(clips) == 1
    assert "data:image/webp" in clips[0]
    assert re.search(r'aria-label="best 1: .* on the ground: FR \d+%, FL', clips[0])
    assert "feet down</text>" in clips[0]


def test_before_a_training_on_a_reward_its_return_has_no_empty_frame(
    run: Path,
) -> None:
    titles: list[str] = []

    def titled(axes: Axes, alt: str = "") -> str:
        del alt
        titles.append(axes.get_title())
        return ""

    with curves_of_reports.blank(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_report, "svg_of", titled)
        text = run_report.render(run, read_config(run), read_rounds(run)[:1])
    assert "in 1 round by the" in text
    assert [title for title in titles if title.startswith("Return under")]
    assert not [title for title in titles if title.startswith("Learned return")]


def test_a_manoeuvre_of_20_s_takes_no_more_room_on_the_page_than_its_pictures(
    shot: Shot,
) -> None:
    short = Shot(mjcf=shot.mjcf, qpos=shot.qpos[:50], dt_s=0.02)
    long = Shot(mjcf=shot.mjcf, qpos=np.resize(shot.qpos, (1000, 19)), dt_s=0.02)
    assert pace_of_clip(short).fps == 12.5
    assert frame_count((long,), pace_of_clip(long)) == 120


def test_a_head_of_the_table_says_what_it_means(run: Path) -> None:
    """Where it is pointed at, and below the table for who cannot point."""
    text = write_report(run).read_text()
    heads = re.findall(r'<th(?: title="([^"]+)")?>([^<]+)</th>', text)
    assert [head for means, head in heads if not means] == ["round"]
    meaning = {head: means for means, head in heads}
    assert "KL divergence" in meaning["drift"]
    assert "farther" in meaning["far"]
    for head in ("far", "drift", "spread"):
        assert f"{head.capitalize()}: {meaning[head]}." in text


def test_the_page_says_when_and_with_what_a_run_was_made(run: Path) -> None:
    """And which commands show more; what was typed cannot act on the page."""
    note_start(run, "gaitpref loop --run <script>")
    note_round(run, 0)
    text = write_report(run).read_text()
    assert "gaitpref loop --run &lt;script&gt;" in text
    assert re.search(r"<dt>begun</dt><dd>\d{4}-\d\d-\d\d", text)
    assert f"gaitpref {__version__}" in text
    for command in ("gaitpref play --policy", "gaitpref watch", "tensorboard --logdir"):
        assert f"<code>{command}" in text
    for link in re.findall(r'href="(\.\.[^"]+)"', text):
        assert (run / "report" / link).exists()
    (run / JOURNAL_NAME).unlink()


def test_who_was_not_shown_alike_is_not_compared(run: Path) -> None:
    dataset = Dataset.open(run / "dataset")
    one = dataset.entries()[-1].meta.policy_sha256
    assert before_and_after(dataset, one, one, most_s=1) is None
    assert before_and_after(dataset, one, "no policy", most_s=1) is None


def test_legs_are_drawn_as_lines_where_nothing_draws_shapes(
    shot: Shot, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(*_: object) -> None:
        raise ImportError("no EGL")

    monkeypatch.setattr(camera, "_context", nothing)
    with pytest.raises(NoRenderer, match=r"no EGL.*install EGL"):
        next(frames_of(shot.mjcf, shot.qpos[:1]))
    assert "<polyline" in write_report(run).read_text()
    figure = stick_figures((shot,))
    assert figure.count("<animate") == 5
    lines = leg_lines(shot.mjcf, shot.qpos[:1])[0]
    # Front legs are ahead of hind legs, feet below knees below hips.
    assert lines[:2, 0, 0].min() > lines[2:, 0, 0].max()
    assert (np.diff(lines[:, :, 1], axis=1) < 0).all()


def test_a_film_of_nothing_is_refused(shot: Shot) -> None:
    with pytest.raises(ValueError, match="S > 0"):
        Shot(mjcf=shot.mjcf, qpos=shot.qpos[:0], dt_s=0.02)
    with pytest.raises(ValueError, match="16 to 4096"):
        CameraCfg(width_px=5000)
    assert webp_of(iter([np.zeros((16, 16, 3), np.uint8)]), 10)


_BALL = """
<mujoco>
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1" directional="true"/>
    <geom type="plane" size="5 5 0.1" rgba="0.9 0.9 0.9 1"/>
    {more}
    <body>
      <freejoint/>
      <geom type="sphere" size="0.1" rgba="1 0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""
_BLOCK = '<geom type="box" size="0.1 0.1 0.1" pos="0 40 0.1"/>'


@pytest.mark.parametrize("more", ["", _BLOCK], ids=["flat floor", "block on it"])
def test_a_shadow_is_farther_from_what_is_higher_above_the_floor(more: str) -> None:
    heights_m = (0.1, 0.3, 0.5)
    states = np.array([[0, 0, z, 1, 0, 0, 0] for z in heights_m], float)
    try:
        pictures = list(frames_of(_BALL.format(more=more), states))
    except NoRenderer as why:
        pytest.skip(str(why))
    apart_px = []
    for picture in pictures:
        red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
        ball = (red > 60) & (red > 2 * green)
        on_floor = (abs(red - blue) < 40) & ~ball
        lit = np.median(green[-10:])
        shadow = on_floor & (green < 0.75 * lit) & (np.arange(len(green)) > 80)[:, None]
        assert ball.sum() > 100
        assert shadow.sum() > 50
        apart_px.append(np.nonzero(shadow)[0].mean() - np.nonzero(ball)[0].mean())
    assert apart_px[0] < apart_px[1] < apart_px[2]


def test_an_endless_floor_of_few_tiles_looks_like_one_of_many(
    shot: Shot, monkeypatch: pytest.MonkeyPatch, drawn: list[np.ndarray]
) -> None:
    """Its tiles, its horizon and its haze; far from where the world begins, too."""
    mj_model = mujoco.MjModel.from_xml_string(shot.mjcf)
    assert endless_floor(mj_model) is not None
    states = shot.qpos[:2].copy()
    states[1, :2] += 33.3, -7.7
    few = np.array(list(frames_of(shot.mjcf, states)), int)
    monkeypatch.setattr(camera, "endless_floor", lambda _: None)
    many = np.array(list(frames_of(shot.mjcf, states)), int)
    assert np.abs(few - many).max() <= 2
    assert many[:, 60:, :60].std(axis=(1, 2)).min() > 2


@pytest.mark.parametrize(
    ("part", "other"),
    [
        ('directional="true"', 'directional="false"'),
        ('size="0 0 0.05"', 'size="9 9 0.05"'),
        ('texuniform="true"', 'texuniform="false"'),
    ],
)
def test_a_floor_that_would_look_different_of_few_tiles_keeps_its_own(
    part: str, other: str
) -> None:
    mjcf = """<mujoco><asset>
      <texture name="t" type="2d" builtin="checker" width="8" height="8"/>
      <material name="m" texture="t" texuniform="true"/></asset><worldbody>
      <light directional="true"/><geom type="plane" size="0 0 0.05" material="m"/>
      </worldbody></mujoco>"""
    plain, changed = (
        mujoco.MjModel.from_xml_string(text)
        for text in (mjcf, mjcf.replace(part, other))
    )
    assert endless_floor(plain) is not None
    assert endless_floor(changed) is None
