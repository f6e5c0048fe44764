-- The trace that a job goes on (W3C traceparent).
ALTER TABLE jobs ADD COLUMN traceparent TEXT;
