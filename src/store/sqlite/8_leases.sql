-- Until when a running job is its worker's, ms since 1970 by the database's clock.
ALTER TABLE jobs ADD COLUMN lease_until INTEGER;
