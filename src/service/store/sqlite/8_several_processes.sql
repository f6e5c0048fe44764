-- Until when a running job is its worker's, and since when a job waits: ms since 1970 by the database's clock.
ALTER TABLE jobs ADD COLUMN lease_until INTEGER;
ALTER TABLE jobs ADD COLUMN waits_since INTEGER;
-- The process that began it last.
ALTER TABLE jobs ADD COLUMN worker TEXT;
