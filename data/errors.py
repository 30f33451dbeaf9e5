"""Exceptions a caller reacts to; everything else is ValueError, TypeError or KeyError.

GaitprefError            what went wrong lies in the user's input or files
├── FileError            a path leads to no file, or to one that is too large
├── EpisodeError         an episode file cannot be used
│   ├── UnsupportedSchema    written under a schema this code does not read
│   ├── TruncatedEpisode     the writer died before closing the file
│   └── CorruptEpisode       its bytes are not what was written
├── DatasetError         a data set directory or its manifest cannot be used
 ├── RemoteError          what is behind a URL cannot be used
├── AnswerError          the answer store cannot be used
│   └── AnswersUnreachable   no server of answers is there
└── RankLost             a process that trained along is gone
"""


class GaitprefError(Exception):
    """Something the user can mend; its message is one line that says how."""

    lines: str = ""
    """What to write into a file, shown below the message as it is."""


class FileError(GaitprefError):
    """A path leads to something that is no file, or to one that cannot be taken."""


class EpisodeError(GaitprefError):
    """An episode file cannot be used."""


class UnsupportedSchema(EpisodeError):
    """The file was written under a schema this code does not read."""


class TruncatedEpisode(EpisodeError):
    """The writer died before closing the file; complete chunks are recoverable."""


class CorruptEpisode(EpisodeError):
    """The file's bytes are not what was written."""


class DatasetError(GaitprefError):
    """A data set directory or its manifest cannot be used."""


class RemoteError(GaitprefError):
    """What is behind a URL cannot be read or written."""


class AnswerError(GaitprefError):
    """The answer store cannot be used."""


class AnswersUnreachable(AnswerError):
    """No server of answers is there; nothing is known about the answers themselves."""


class RankLost(GaitprefError):
    """Another process of a training is gone; it, or torchrun, tells why."""
