-- A job that goes on where another one missed its budget: the ids of both, each in the row of the other.
ALTER TABLE jobs ADD COLUMN continues TEXT;
ALTER TABLE jobs ADD COLUMN continued_by TEXT;
