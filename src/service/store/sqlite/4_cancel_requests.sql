-- When a job was asked to stop: it ends as cancelled, whatever happens to the process.
ALTER TABLE jobs ADD COLUMN cancel_requested_at TEXT;
