"""How much is read of what may come from a stranger or a hand, in one place.

A file that claims more is refused before it is read. Every limit lies far above what
the project itself writes, and together they bound the memory that a file can cost.
"""

from __future__ import annotations

EPISODE_BYTES = 512 * 2**20
"""One episode file; ten minutes at 50 Hz take 30 MB."""
EPISODE_CHUNK_BYTES = 32 * 2**20
"""What a chunk of an episode may unpack to: 250 times what the writer puts into one."""
EPISODE_UNPACKED_BYTES = 256 * 2**20
"""What all chunks of an episode may unpack to."""
BAG_CHUNK_BYTES = 256 * 2**20
"""What a chunk of a ROS bag may unpack to, and the longest record in one; 0.75 MB are
usual, a chunk holds one message at least."""
BAG_FILE_BYTES = 8 * 2**30
"""What a file of a ROS bag that is packed as a whole may unpack to."""
LOG_TABLE_BYTES = 2 * 2**30
"""A table of a robot's log, and what the columns that are read of it may take."""
MANIFEST_BYTES = 512 * 2**20
"""A manifest; each of its episodes takes 1 kB."""
MANIFEST_LINE_BYTES = 2**20
"""What a manifest says of one episode."""
ARCHIVE_DIRECTORY_BYTES = 64 * 2**20
"""What an archive says of its files before they are looked at; each takes 130 bytes."""
ANSWERS_BYTES = 512 * 2**20
"""The answers in an archive; each takes 0.5 kB, its pair as much."""
POLICY_BYTES = 512 * 2**20
"""A policy file, or what training goes on from."""
TABLE_BYTES = 512 * 2**20
"""A table of segments, or of answers about them."""
REWARD_BYTES = 512 * 2**20
"""The tensors of a reward model."""
FACTS_BYTES = 64 * 2**20
"""What a run or a reward says of itself in JSON or YAML."""
MODEL_BYTES = 256 * 2**20
"""A robot's model with its meshes in its text; 1 to 6 MB are usual."""
ROBOT_BYTES = 64 * 2**20
"""The text of a robot's model, without its meshes."""
TEXT_BYTES = 2**20
"""A file that a person wrote: a map of a bag, hints for a robot."""
GUIDELINES_BYTES = 200_000
"""What raters are told to look for; every page carries it."""
PICKLE_BYTES = 2 * 2**30
"""A pickle of another project: its arrays are what it is for."""
BIGGEST_INTEGER = 2**63 - 1
"""What a column of the answers can hold."""
RATERS_BYTES = 4 * 2**20
"""The tokens of raters; each takes 150 bytes."""

NAME_CHARS = 40
"""The name of a rater who has a token."""
RATER_ID_CHARS = 200
"""What any rater is called in a store; programs have longer names than people."""
NOTE_CHARS = 1000
"""A note, and the reason why a clip is bad."""
