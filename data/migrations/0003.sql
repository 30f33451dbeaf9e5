-- Version 3: every row carries a checksum of its values, because SQLite has none. Rows
-- are append-only, so it is written once; only older ones get it here.
DROP TRIGGER answer_no_update;
DROP TRIGGER pair_no_update;

ALTER TABLE rater ADD COLUMN crc32 INTEGER;
ALTER TABLE pair ADD COLUMN crc32 INTEGER;
ALTER TABLE answer ADD COLUMN crc32 INTEGER;

UPDATE rater SET crc32 = row_crc32(rater_id, kind, info_json);
UPDATE pair SET crc32 = row_crc32(pair_id, a_rollout, a_start, a_steps, b_rollout,
  b_start, b_steps, strategy, round, info_json);
UPDATE answer SET crc32 = row_crc32(answer_id, pair_id, rater_id, choice, p_a,
  shown_left, shown_ms, watched_ms, response_ms, confidence, note, reason, supersedes,
  client_json, created_utc, role);

CREATE TRIGGER answer_no_update BEFORE UPDATE ON answer
  BEGIN SELECT RAISE(ABORT, 'answers are append-only'); END;
CREATE TRIGGER pair_no_update BEFORE UPDATE ON pair
  BEGIN SELECT RAISE(ABORT, 'pairs are append-only'); END;
