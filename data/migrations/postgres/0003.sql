-- The store on PostgreSQL, in the version that SQLite calls 3. Columns have the names
-- and the values they have there, so that one set of statements serves both.
-- Texts are compared byte by byte, as SQLite does, whatever the language of the server.
CREATE TABLE rater (
  rowid     BIGINT GENERATED ALWAYS AS IDENTITY,   -- order in which raters came
  rater_id  TEXT COLLATE "C" PRIMARY KEY,
  kind      TEXT NOT NULL CHECK (kind IN ('human', 'scripted', 'model')),
  info_json TEXT NOT NULL CHECK (info_json::json IS NOT NULL),
  crc32     BIGINT
);
--;
CREATE TABLE pair (
  position  BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
  pair_id   TEXT COLLATE "C" NOT NULL UNIQUE,
  a_rollout TEXT NOT NULL,
  a_start   BIGINT NOT NULL CHECK (a_start >= 0),
  a_steps   BIGINT NOT NULL CHECK (a_steps > 0),
  b_rollout TEXT NOT NULL,
  b_start   BIGINT NOT NULL CHECK (b_start >= 0),
  b_steps   BIGINT NOT NULL CHECK (b_steps > 0),
  strategy  TEXT NOT NULL,
  round     BIGINT NOT NULL CHECK (round >= 0),
  info_json TEXT NOT NULL CHECK (info_json::json IS NOT NULL),
  crc32     BIGINT
);
--;
CREATE TABLE answer (
  position    BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
  answer_id   TEXT COLLATE "C" NOT NULL UNIQUE,
  pair_id     TEXT COLLATE "C" NOT NULL REFERENCES pair (pair_id),
  rater_id    TEXT COLLATE "C" NOT NULL REFERENCES rater (rater_id),
  choice      TEXT NOT NULL CHECK (choice IN ('a', 'b', 'equal', 'skip', 'bad')),
  p_a         DOUBLE PRECISION CHECK (p_a BETWEEN 0 AND 1),
  shown_left  TEXT NOT NULL CHECK (shown_left IN ('a', 'b')),
  shown_ms    BIGINT CHECK (shown_ms >= 0),
  watched_ms  BIGINT CHECK (watched_ms >= 0),
  response_ms BIGINT CHECK (response_ms >= 0),
  confidence  DOUBLE PRECISION CHECK (confidence BETWEEN 0 AND 1),
  note        TEXT NOT NULL,
  reason      TEXT NOT NULL,
  supersedes  TEXT COLLATE "C" REFERENCES answer (answer_id),
  client_json TEXT NOT NULL CHECK (client_json::json IS NOT NULL),
  created_utc TEXT COLLATE "C" NOT NULL,
  role        TEXT NOT NULL CHECK (role IN ('first', 'repeat', 'undo')),
  crc32       BIGINT
);
--;
CREATE TABLE question (
  position    BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
  question_id TEXT COLLATE "C" NOT NULL UNIQUE,
  rater_id    TEXT COLLATE "C" NOT NULL REFERENCES rater (rater_id),
  pair_id     TEXT COLLATE "C" NOT NULL REFERENCES pair (pair_id),
  role        TEXT NOT NULL CHECK (role IN ('first', 'repeat')),
  shown_left  TEXT NOT NULL CHECK (shown_left IN ('a', 'b')),
  supersedes  TEXT COLLATE "C" REFERENCES answer (answer_id),
  shown_utc   TEXT COLLATE "C" NOT NULL,
  expires_utc TEXT COLLATE "C" NOT NULL
);
--;
-- The one function of SQLite that the statements use: '$.key' of an object.
CREATE FUNCTION json_extract(document TEXT, path TEXT) RETURNS TEXT
  LANGUAGE sql IMMUTABLE AS $$ SELECT document::json ->> substr(path, 3) $$;
--;
CREATE VIEW answer_current AS
  SELECT * FROM answer AS old
  WHERE old.role <> 'undo'
  AND NOT EXISTS (SELECT 1 FROM answer AS new WHERE new.supersedes = old.answer_id);
--;
CREATE INDEX answer_pair ON answer (pair_id, rater_id);
--;
CREATE INDEX answer_rater ON answer (rater_id, position);
--;
CREATE UNIQUE INDEX answer_supersedes ON answer (supersedes) WHERE supersedes IS NOT NULL;
--;
CREATE INDEX question_rater ON question (rater_id);
--;
CREATE INDEX question_pair ON question (pair_id);
--;
CREATE INDEX pair_newest ON pair (round DESC, position);
--;
CREATE INDEX pair_gold ON pair (pair_id) WHERE json_extract(info_json, '$.gold') IS NOT NULL;
--;
CREATE FUNCTION append_only() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN RAISE EXCEPTION '% rows are append-only', TG_TABLE_NAME; END $$;
--;
CREATE TRIGGER answer_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON answer
  FOR EACH STATEMENT EXECUTE FUNCTION append_only();
--;
CREATE TRIGGER pair_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON pair
  FOR EACH STATEMENT EXECUTE FUNCTION append_only();
