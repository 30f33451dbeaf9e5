-- Version 4: an answer can say what of the gait decided it. The view, which has its new
-- column last, keeps its grants.
ALTER TABLE answer ADD COLUMN why TEXT NOT NULL DEFAULT ''
  CHECK (why IN ('', 'posture', 'feet', 'rhythm', 'steadiness', 'effort'));
--;
CREATE OR REPLACE VIEW answer_current AS
  SELECT * FROM answer AS old
  WHERE old.role <> 'undo'
  AND NOT EXISTS (SELECT 1 FROM answer AS new WHERE new.supersedes = old.answer_id);
