-- Time that the service was seen to run, and the clock of which it is known that it did not run ahead (see `look.rs`); all in ms.
ALTER TABLE store ADD COLUMN ran_ms BIGINT NOT NULL DEFAULT 0;
ALTER TABLE store ADD COLUMN looked_at BIGINT NOT NULL DEFAULT 0;
ALTER TABLE store ADD COLUMN settled_at BIGINT NOT NULL DEFAULT 0;
ALTER TABLE store ADD COLUMN noted_at BIGINT;
ALTER TABLE store ADD COLUMN noted_ran_ms BIGINT NOT NULL DEFAULT 0;
-- Running time at the deletion, and whether the retention of unused sessions deleted it.
ALTER TABLE tombstones ADD COLUMN ran_ms BIGINT NOT NULL DEFAULT 0;
ALTER TABLE tombstones ADD COLUMN expired BIGINT NOT NULL DEFAULT 0;
-- A restored session counts as used then.
ALTER TABLE sessions ADD COLUMN restored_at TEXT COLLATE "C";
