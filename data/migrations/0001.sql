-- Store of pairs and answers, version 1. Clips describe themselves (episode hash, first
-- step, number of steps), so there is no table of episodes: the manifest knows those.
CREATE TABLE rater (
  rater_id  TEXT PRIMARY KEY,                      -- a pseudonym
  kind      TEXT NOT NULL CHECK (kind IN ('human', 'scripted', 'model')),
  info_json TEXT NOT NULL CHECK (json_valid(info_json))
) STRICT;

CREATE TABLE pair (
  position  INTEGER PRIMARY KEY,                   -- order in which pairs were added
  pair_id   TEXT NOT NULL UNIQUE,                  -- hash of both clips and the question
  a_rollout TEXT NOT NULL,
  a_start   INTEGER NOT NULL CHECK (a_start >= 0),
  a_steps   INTEGER NOT NULL CHECK (a_steps > 0),
  b_rollout TEXT NOT NULL,
  b_start   INTEGER NOT NULL CHECK (b_start >= 0),
  b_steps   INTEGER NOT NULL CHECK (b_steps > 0),
  strategy  TEXT NOT NULL,                         -- how the pair was chosen
  round     INTEGER NOT NULL CHECK (round >= 0),
  info_json TEXT NOT NULL CHECK (json_valid(info_json))
) STRICT;
CREATE INDEX pair_round ON pair (round);

CREATE TABLE answer (                              -- append only; a correction is a new row
  position    INTEGER PRIMARY KEY,                 -- order in which answers arrived
  answer_id   TEXT NOT NULL UNIQUE,                -- made by the client: a retry is harmless
  pair_id     TEXT NOT NULL REFERENCES pair (pair_id),
  rater_id    TEXT NOT NULL REFERENCES rater (rater_id),
  choice      TEXT NOT NULL CHECK (choice IN ('a', 'b', 'equal', 'skip', 'bad')),
  p_a         REAL CHECK (p_a BETWEEN 0 AND 1),    -- graded strength; NULL if not asked
  shown_left  TEXT NOT NULL CHECK (shown_left IN ('a', 'b')),
  shown_ms    INTEGER CHECK (shown_ms >= 0),
  watched_ms  INTEGER CHECK (watched_ms >= 0),
  response_ms INTEGER CHECK (response_ms >= 0),
  confidence  REAL CHECK (confidence BETWEEN 0 AND 1),
  note        TEXT NOT NULL,
  reason      TEXT NOT NULL,                       -- why a clip is bad
  supersedes  TEXT REFERENCES answer (answer_id),
  client_json TEXT NOT NULL CHECK (json_valid(client_json)),
  created_utc TEXT NOT NULL
) STRICT;
CREATE INDEX answer_pair ON answer (pair_id);
CREATE INDEX answer_rater ON answer (rater_id, position);
-- One correction of an answer at most; and without it `answer_current` is quadratic.
CREATE UNIQUE INDEX answer_supersedes ON answer (supersedes) WHERE supersedes IS NOT NULL;

CREATE TABLE lease (                               -- who is shown what; may be lost
  pair_id     TEXT NOT NULL REFERENCES pair (pair_id),
  rater_id    TEXT NOT NULL REFERENCES rater (rater_id),
  expires_utc TEXT NOT NULL,
  PRIMARY KEY (pair_id, rater_id)
) STRICT, WITHOUT ROWID;

CREATE VIEW answer_current AS
  SELECT * FROM answer AS old
  WHERE NOT EXISTS (SELECT 1 FROM answer AS new WHERE new.supersedes = old.answer_id);

CREATE TRIGGER answer_no_update BEFORE UPDATE ON answer
  BEGIN SELECT RAISE(ABORT, 'answers are append-only'); END;
CREATE TRIGGER answer_no_delete BEFORE DELETE ON answer
  BEGIN SELECT RAISE(ABORT, 'answers are append-only'); END;
CREATE TRIGGER pair_no_update BEFORE UPDATE ON pair
  BEGIN SELECT RAISE(ABORT, 'pairs are append-only'); END;
CREATE TRIGGER pair_no_delete BEFORE DELETE ON pair
  BEGIN SELECT RAISE(ABORT, 'pairs are append-only'); END;
