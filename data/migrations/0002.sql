-- Version 2: an answer can be a repeat or take another one back, and what a rater is
-- shown survives a restart of the page.
ALTER TABLE answer ADD COLUMN role TEXT NOT NULL DEFAULT 'first'
  CHECK (role IN ('first', 'repeat', 'undo'));

-- An answer that was taken back is superseded by a row that is no answer itself.
DROP VIEW answer_current;
CREATE VIEW answer_current AS
  SELECT * FROM answer AS old
  WHERE old.role <> 'undo'
  AND NOT EXISTS (SELECT 1 FROM answer AS new WHERE new.supersedes = old.answer_id);

DROP TABLE lease;
CREATE TABLE question (                            -- who is shown what; may be lost
  position    INTEGER PRIMARY KEY,                 -- of a rater's, the last is on the screen
  question_id TEXT NOT NULL UNIQUE,                -- becomes the id of the answer
  rater_id    TEXT NOT NULL REFERENCES rater (rater_id),
  pair_id     TEXT NOT NULL REFERENCES pair (pair_id),
  role        TEXT NOT NULL CHECK (role IN ('first', 'repeat')),
  shown_left  TEXT NOT NULL CHECK (shown_left IN ('a', 'b')),
  supersedes  TEXT REFERENCES answer (answer_id),  -- the answer that was reopened
  shown_utc   TEXT NOT NULL,
  expires_utc TEXT NOT NULL                        -- until then nobody else is shown it
) STRICT;
CREATE INDEX question_rater ON question (rater_id);
CREATE INDEX question_pair ON question (pair_id);

-- The queue asks for the newest round first, and must not sort all pairs for the first.
CREATE INDEX pair_newest ON pair (round DESC);
DROP INDEX pair_round;
CREATE INDEX pair_gold ON pair (pair_id) WHERE json_extract(info_json, '$.gold') IS NOT NULL;

-- With both columns, "has this rater answered this pair" is one look-up.
DROP INDEX answer_pair;
CREATE INDEX answer_pair ON answer (pair_id, rater_id);
