-- What a job goes on with when another worker takes it over: the blob of its last milestone, until it ends.
ALTER TABLE jobs ADD COLUMN milestone_blob TEXT;
