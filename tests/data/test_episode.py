"""Episode records and files: what is written is what is read, or an error says why.

Shapes: T steps of the episode.
"""

import io
import json
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import CompressionType, Writer

from data.episodes import schema
from data.episodes import writer as episode_writer
from data.episodes.chunks import Compression
from data.episodes.episode import (
    END_REASONS,
    EndReason,
    Episode,
    EpisodeMeta,
    decode_episode,
    decode_features,
    read_episode,
)
from data.episodes.mcap_records import chunk_content
from data.episodes.writer import encode_episode
from data.errors import (
    CorruptEpisode,
    EpisodeError,
    TruncatedEpisode,
    UnsupportedSchema,
)
from data.features import FEATURE_DIM, column

META = EpisodeMeta(
    task="velocity",
    seed=7,
    env_index=3,
    command=(0.5, -0.1, 0.25),
    policy_sha256="c" * 64,
    policy_step=1_000_000,
    stochastic=True,
    control_dt_s=0.02,
    physics_dt_s=0.004,
    robot="go1_like",
    model_sha256="d" * 64,
    round=2,
    extra={"friction": "0.8", "länge": "ß\n"},
)
ARRAYS = ("qpos", "qvel", "obs", "action", "ctrl", "features", "reward")
SPECIAL = np.array([np.nan, np.inf, -np.inf, -0.0, 1e-45, 3e38])


def make_episode(num_steps: int, seed: int = 0, **changes: object) -> Episode:
    """An episode of noise, with some NaN, infinities and other special numbers."""
    rng = np.random.default_rng(seed)

    def noise(*shape: int, dtype: str = "float32") -> np.ndarray:
        array = rng.normal(size=shape)
        special = rng.random(shape) < 0.05
        array[special] = rng.choice(SPECIAL, size=int(special.sum()))
        return array.astype(dtype)

    values: dict[str, object] = {
        "qpos": noise(num_steps + 1, 19, dtype="float64"),
        "qvel": noise(num_steps + 1, 18, dtype="float64"),
        "obs": noise(num_steps + 1, 48),
        "action": noise(num_steps, 12),
        "ctrl": noise(num_steps, 12),
        "features": noise(num_steps, FEATURE_DIM),
        "reward": noise(num_steps),
        "end_reason": "truncated",
        "meta": META,
        "mjcf": "<mujoco model='täst'/>",
    }
    return Episode(**(values | changes))  # type: ignore[arg-type]


def assert_same(left: Episode, right: Episode) -> None:
    for name in ARRAYS:
        assert getattr(left, name).dtype == getattr(right, name).dtype, name
        assert getattr(left, name).tobytes() == getattr(right, name).tobytes(), name
    assert left.meta == right.meta
    assert (left.end_reason, left.mjcf) == (right.end_reason, right.mjcf)


@settings(max_examples=30, deadline=None)
@given(
    num_steps=st.sampled_from([1, 2, 40, 127, 128, 129, 256, 300]),
    compression=st.sampled_from(["", "zstd"]),
    seed=st.integers(0, 2**32 - 1),
    end_reason=st.sampled_from(END_REASONS),
    mjcf=st.text(st.characters(exclude_categories=["Cs"]), max_size=50),
    extra=st.dictionaries(st.text("ab.:é", max_size=4), st.text("x\n\0", max_size=4)),
    control_dt_s=st.floats(1e-4, 1.0),
    command=st.tuples(*[st.floats(-3, 3)] * 3),
)
def test_reading_gives_bit_for_bit_what_was_written(
    num_steps: int,
    compression: Compression,
    seed: int,
    end_reason: EndReason,
    mjcf: str,
    extra: dict[str, str],
    control_dt_s: float,
    command: tuple[float, float, float],
) -> None:
    """Any length, NaN and infinities included; and twice the same bytes."""
    meta = replace(META, extra=extra, control_dt_s=control_dt_s, command=command)
    episode = make_episode(num_steps, seed, end_reason=end_reason, mjcf=mjcf, meta=meta)
    content = encode_episode(episode, compression=compression)
    again = decode_episode(content, "x")
    assert_same(again, episode)
    assert encode_episode(again, compression=compression) == content


def test_an_episode_without_steps_is_refused() -> None:
    """There is nothing to judge in it; the message names the array."""
    with pytest.raises(ValueError, match="action has no rows"):
        make_episode(0)


def test_a_chunk_that_unpacks_to_too_much_is_refused() -> None:
    """A count in the file does not decide how much memory is taken."""
    content = bytearray(encode_episode(make_episode(2), compression="zstd"))
    start = content.index(b"zstd") - 4 - 4 - 8
    struct.pack_into("<Q", content, start, 2**40)
    with pytest.raises(ValueError, match="claims to unpack to 1099511627776 bytes"):
        chunk_content(bytes(content[start - 25 :]))


@pytest.mark.parametrize("compression", ["", "zstd"])
def test_the_official_reader_reads_many_chunks(compression: Compression) -> None:
    """All steps in order, whatever chunk they lie in."""
    episode = make_episode(300)
    content = encode_episode(episode, compression=compression)
    reader = make_reader(io.BytesIO(content), validate_crcs=True)
    messages = [m for _, _, m in reader.iter_messages(topics=[schema.STEP_TOPIC])]
    assert [message.sequence for message in messages] == list(range(300))
    rows = [np.frombuffer(m.data, "<f4", 90, 4 + 296 + 72 * 4) for m in messages]
    np.testing.assert_array_equal(np.stack(rows), episode.features)


def test_a_written_file_gives_episode_and_features(tmp_path: Path) -> None:
    """Features alone are the same rows; nothing else stays behind."""
    episode = make_episode(5)
    (tmp_path / "e.mcap").write_bytes(encode_episode(episode))
    assert_same(read_episode(tmp_path / "e.mcap"), episode)
    features = decode_features((tmp_path / "e.mcap").read_bytes(), "e.mcap")
    assert features.tobytes() == episode.features.tobytes()
    assert [path.name for path in tmp_path.iterdir()] == ["e.mcap"]
    with pytest.raises(ValueError, match="read-only"):
        features[0] = 0


def test_the_official_reader_sees_the_same_values() -> None:
    """Through mcap with checksums on, every field unpacked with `struct` alone."""
    episode = make_episode(3, end_reason="terminated")
    content = encode_episode(episode)
    for reader_type in (make_reader, NonSeekingReader):
        reader = reader_type(io.BytesIO(content), validate_crcs=True)
        found = list(reader.iter_messages(topics=[schema.STEP_TOPIC]))
        assert len(found) == 3
        for step, (step_schema, channel, message) in enumerate(found):
            assert step_schema is not None
            assert (step_schema.name, step_schema.encoding) == (
                "gaitpref/msg/StepV1",
                "ros2msg",
            )
            assert channel.message_encoding == "cdr"
            assert message.log_time == message.publish_time == step * 20_000_000
            assert message.sequence == step
            assert message.data[:4] == b"\x00\x01\x00\x00"
            values = struct.unpack("<37d48f12f12f90ffI2B", message.data[4:])
            expected = [
                getattr(episode, name)[step].ravel().tolist() for name in ARRAYS
            ]
            np.testing.assert_array_equal(values[:-3], np.concatenate(expected))
            assert values[-3:] == (step, int(step == 2), 0)


def test_the_official_reader_sees_final_state_metadata_and_model() -> None:
    """The message behind the last step holds row T; metadata is text only."""
    episode = make_episode(3)
    content = encode_episode(episode)
    reader = make_reader(io.BytesIO(content), validate_crcs=True)
    ((_, _, message),) = reader.iter_messages(topics=[schema.FINAL_TOPIC])
    assert (message.sequence, message.log_time) == (3, 60_000_000)
    values = struct.unpack("<19d18d48f", message.data[4:])
    expected = np.concatenate([episode.qpos[-1], episode.qvel[-1], episode.obs[-1]])
    np.testing.assert_array_equal(values, expected)

    (record,) = reader.iter_metadata()
    assert record.name == "episode"
    assert record.metadata["command"] == "[0.5, -0.1, 0.25]"
    assert record.metadata["end_reason"] == "truncated"
    assert record.metadata["n_steps"] == "3"
    assert record.metadata["extra.friction"] == "0.8"
    (attachment,) = reader.iter_attachments()
    assert attachment.name == "model/scene.xml"
    assert attachment.data.decode() == episode.mjcf


def test_the_summary_counts_what_is_there() -> None:
    """Tools that only look at the summary find statistics and feature names."""
    summary = make_reader(io.BytesIO(encode_episode(make_episode(4)))).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 5
    assert summary.statistics.channel_message_counts == {1: 4, 2: 1}
    names = json.loads(summary.channels[1].metadata["feature_names"])
    assert len(names) == FEATURE_DIM
    assert names[column("base_height")] == ["base_height"]
    assert names[column("joint_vel")][:2] == ["joint_vel.FR_hip", "joint_vel.FR_thigh"]


def test_messages_have_no_padding() -> None:
    """37 * 8 + (48 + 24 + 90 + 2) * 4 + 2 bytes for a step, 488 for a final state."""
    assert schema.body_dtype(schema.STEP_FIELDS).itemsize == 954
    assert schema.body_dtype(schema.FINAL_FIELDS).itemsize == 488
    assert "float32[90] features" in schema.message_text(schema.STEP_FIELDS)
    assert "\nfloat32 reward" in schema.message_text(schema.STEP_FIELDS)


def test_every_truncated_file_is_reported() -> None:
    """Cut anywhere, a file is called truncated and told what to do."""
    content = encode_episode(make_episode(2))
    for size in [
        *range(0, len(content), 61),
        *range(len(content) - 40, len(content)),
    ]:
        with pytest.raises(
            TruncatedEpisode, match=rf"^f.mcap stops after {size} bytes"
        ):
            decode_episode(content[:size], "f.mcap")


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(position=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_every_flipped_bit_is_reported(position: float, bit: int) -> None:
    """No bit of the file, text and indexes included, can change unnoticed."""
    content = bytearray(FLIPPABLE)
    content[int(position * len(content))] ^= 1 << bit
    with pytest.raises(EpisodeError, match=r"^f\.mcap .*; "):
        decode_episode(bytes(content), "f.mcap")


FLIPPABLE = encode_episode(make_episode(2))


@settings(max_examples=300, deadline=None)
@example(position=0.03125, patch=b"\n")
@given(
    position=st.floats(0, 1, exclude_max=True), patch=st.binary(min_size=1, max_size=9)
)
def test_forged_files_never_raise_anything_else(position: float, patch: bytes) -> None:
    """With all checksums made right again, foreign bytes still give one error type."""
    forged = bytearray(FLIPPABLE)
    start = min(int(position * len(forged)), len(forged) - len(patch))
    forged[start : start + len(patch)] = patch
    summary = make_reader(io.BytesIO(FLIPPABLE)).get_summary()
    assert summary is not None
    chunk_start = summary.chunk_indexes[0].chunk_start_offset
    chunk_size = summary.chunk_indexes[0].uncompressed_size
    (summary_start,) = struct.unpack_from("<Q", FLIPPABLE, len(FLIPPABLE) - 28)
    view = memoryview(forged)
    for offset, part in (
        (chunk_start + 33, view[chunk_start + 49 :][:chunk_size]),
        (summary_start - 4, view[: summary_start - 13]),
        (len(forged) - 12, view[summary_start:-12]),
    ):
        struct.pack_into("<I", forged, offset, zlib.crc32(part))
    message = ""
    try:
        decode_episode(bytes(forged), "f.mcap")
    except EpisodeError as error:
        message = str(error)
    assert "\n" not in message
    assert len(message) < 600


def test_another_schema_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of a later version says what it holds and what this version reads."""
    monkeypatch.setattr(schema, "STEP_SCHEMA", "gaitpref/msg/StepV2")
    episode_writer._fixed_records.cache_clear()
    content = encode_episode(make_episode(1))
    monkeypatch.undo()
    episode_writer._fixed_records.cache_clear()
    expected = "holds 'gaitpref/msg/StepV2' on /robot/step, this version reads"
    with pytest.raises(UnsupportedSchema, match=expected):
        decode_episode(content, "f.mcap")


@pytest.mark.parametrize("name", ["schema_sha256", "features_sha256"])
def test_another_feature_row_is_named(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Equal widths with other meanings are refused by their hash."""
    owner = (
        "data.episodes.schema" if name == "schema_sha256" else "data.episodes.writer"
    )
    monkeypatch.setattr(f"{owner}.{name}", lambda: "e" * 64)
    content = encode_episode(make_episode(1))
    monkeypatch.undo()
    with pytest.raises(UnsupportedSchema, match=f"has {name} eeee"):
        decode_episode(content, "f.mcap")


@pytest.mark.parametrize("enable_crcs", [True, False])
def test_a_file_of_another_program_is_no_episode(enable_crcs: bool) -> None:
    """A sound MCAP file with other content says what to give instead."""
    stream = io.BytesIO()
    writer = Writer(
        stream,
        compression=CompressionType.NONE,
        enable_crcs=enable_crcs,
        enable_data_crcs=enable_crcs,
    )
    writer.start()
    writer.finish()
    with pytest.raises(UnsupportedSchema, match="gaitpref record"):
        decode_episode(stream.getvalue(), "f.mcap")
    with pytest.raises(CorruptEpisode, match=r"starts with b'PK"):
        decode_episode(b"PK\x03\x04" * 50, "f.mcap")


@pytest.mark.parametrize("name", ARRAYS)
def test_impossible_arrays_are_named(name: str) -> None:
    """One row too many, or another dtype, is refused with the array's name."""
    array = getattr(make_episode(4), name)
    with pytest.raises(ValueError, match="must have shape"):
        make_episode(4, 0, **{name: np.concatenate([array, array[:1]])})
    other = "float32" if array.dtype == np.float64 else "float64"
    with pytest.raises(TypeError, match=f"^{name} must be a {array.dtype} array"):
        make_episode(4, 0, **{name: array.astype(other)})


def test_arrays_become_read_only_and_views_are_copied() -> None:
    """Neither the holder of an episode nor the owner of a buffer can change it."""
    buffer = np.zeros((9, 12), dtype=np.float32)
    episode = make_episode(4, action=buffer[:4])
    buffer[:] = 1.0
    assert not episode.action.any()
    with pytest.raises(ValueError, match="read-only"):
        episode.qpos[0, 0] = 1.0


def test_times_follow_from_the_control_step() -> None:
    """4 steps of 0.02 s are 0.08 s, with 5 states."""
    episode = make_episode(4)
    assert episode.num_steps == 4
    assert episode.duration_s == pytest.approx(0.08)
    np.testing.assert_allclose(episode.time_s, [0.0, 0.02, 0.04, 0.06, 0.08])


def test_numbers_out_of_arrays_become_plain() -> None:
    """An index or a command taken from numpy is stored like any other."""
    meta = replace(
        META,
        env_index=np.int64(3),
        command=np.array([0.5, 0.0, 0.25]),
    )
    assert EpisodeMeta.from_strings(meta.to_strings()) == meta
    assert type(meta.env_index) is int


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"command": (0.0, float("nan"), 0.0)}, "command must be 3 finite numbers"),
        ({"control_dt_s": 0.0}, "control_dt_s must be positive"),
        ({"seed": -1}, "seed must not be negative"),
        ({"extra": {"a": 1}}, "extra holds text only"),
    ],
)
def test_impossible_facts_are_named(changes: dict[str, object], message: str) -> None:
    """Provenance that cannot be true is refused when it is made, not when read."""
    with pytest.raises(ValueError, match=message):
        replace(META, **changes)
